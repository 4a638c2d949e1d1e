-- Expert iteration: single samples of the prior, refined, and as sampled with the scripted squeeze: means over the objects
-- of the share that succeeds. Fifteen objects are seen and five unseen, by the second fold; one seed.
--
-- pipeline run pipelines/studies/expert.toml --profile table_lift --set ingest.root=$DEXYCB
with
    counts as (
        select case when stage like '%_1' then 2 else 1 end as number, object, object_split,
            1.0 * candidates_n as n, 1.0 * successes_n as s, case when stage like 'screen_drawn%' then 1 else 0 end as drawn
        from all_success where run in (select run from runs)),
    by_object as (
        select number, object, object_split, drawn, 100 * sum(s) / sum(n) as share
        from counts group by number, object, object_split, drawn),
    names as (
        select * from (values (1, 'demonstrations'), (2, 'demonstrations and accepted motions')) as names(number, shown)),
    means as (
        select number,
            avg(case when drawn = 0 and object_split = 'seen' then share end) as refined_seen,
            avg(case when drawn = 0 and object_split = 'unseen' then share end) as refined_unseen,
            avg(case when drawn = 1 and object_split = 'seen' then share end) as drawn_seen,
            avg(case when drawn = 1 and object_split = 'unseen' then share end) as drawn_unseen
        from by_object group by number)
select
    shown as "learned from",
    round(refined_seen, 1) as "refined: succeed, seen, %",
    round(refined_unseen, 1) as "refined: succeed, unseen, %",
    round(drawn_seen, 1) as "as sampled: succeed, seen, %",
    round(drawn_unseen, 1) as "as sampled: succeed, unseen, %"
from means join names on means.number = names.number order by means.number
