-- What a function learns from what refinement made of its own samples on generated shapes: single samples of the prior,
-- refined, and as sampled with the scripted squeeze: means over the objects of the share that succeeds by `full_contact`.
-- Fifteen objects are seen and five unseen, by the first fold; one seed.
--
-- pipeline run pipelines/studies/distilled.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/distilled_again.toml --set ingest.root=$DEXYCB
with
    variants as (
        select run as of_run, case when overrides like '%train_first%' then 1 when overrides like '%train_2%' then 3
            when overrides like '%train_3%' then 4 else 2 end as number
        from runs where run in (select run from runs)),
    by_object as (
        select number, object, object_split, case when stage = 'screen_drawn' then 1 else 0 end as drawn,
            100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join variants on all_success.run = variants.of_run
        where stage in ('screen', 'screen_drawn') group by number, object, object_split, stage),
    names as (
        select * from (values (1, 'motions on shapes'), (2, 'and its own samples, refined'),
            (3, 'the same again'), (4, 'and again')) as names(number, shown))
select
    shown as "learned from",
    round(avg(case when drawn = 1 and object_split = 'seen' then share end), 1) as "as sampled: succeed, seen, %",
    round(avg(case when drawn = 1 and object_split = 'unseen' then share end), 1) as "as sampled: succeed, unseen, %",
    round(avg(case when drawn = 0 and object_split = 'seen' then share end), 1) as "refined: succeed, seen, %",
    round(avg(case when drawn = 0 and object_split = 'unseen' then share end), 1) as "refined: succeed, unseen, %"
from by_object join names on by_object.number = names.number
group by by_object.number, shown
order by by_object.number
