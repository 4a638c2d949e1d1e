-- What is learned of motions on generated shapes: single samples of the prior, refined, and as sampled with the scripted
-- squeeze: means over the objects of the share that succeeds by `full_contact`. Fifteen objects are seen and five unseen,
-- by the first fold; one seed. The tips' error is that of decoded demonstrations at the grasp.
--
-- pipeline run pipelines/studies/shapes_functions.toml --set ingest.root=$DEXYCB
with
    variants as (
        select run as of_run, case when overrides like '%flow%' then 3 when overrides like '%accepted_per_object=0"%' then 1
            else 2 end as number
        from runs where run in (select run from runs)),
    by_object as (
        select number, object, object_split, case when stage = 'screen_drawn' then 1 else 0 end as drawn,
            100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join variants on all_success.run = variants.of_run
        where stage in ('screen', 'screen_drawn') group by number, object, object_split, stage),
    tips as (
        select number as of_number,
            1000 * avg(case when split = 'training' then tip_error_grasp_m end) as seen_mm,
            1000 * avg(case when split = 'unseen' then tip_error_grasp_m end) as unseen_mm
        from all_reconstruction join variants on all_reconstruction.run = variants.of_run group by number),
    names as (
        select * from (values (1, 'demonstrations'), (2, 'and accepted motions on shapes'),
            (3, 'the same, by a wider network with a flow as its prior')) as names(number, shown)),
    means as (
        select number,
            avg(case when drawn = 1 and object_split = 'seen' then share end) as drawn_seen,
            avg(case when drawn = 1 and object_split = 'unseen' then share end) as drawn_unseen,
            avg(case when drawn = 0 and object_split = 'seen' then share end) as refined_seen,
            avg(case when drawn = 0 and object_split = 'unseen' then share end) as refined_unseen
        from by_object group by number)
select
    shown as "learned from",
    round(seen_mm, 1) as "tips, learned, mm",
    round(unseen_mm, 1) as "unseen objects, mm",
    round(drawn_seen, 1) as "as sampled: succeed, seen, %",
    round(drawn_unseen, 1) as "as sampled: succeed, unseen, %",
    round(refined_seen, 1) as "refined: succeed, seen, %",
    round(refined_unseen, 1) as "refined: succeed, unseen, %"
from means join names on means.number = names.number join tips on means.number = tips.of_number
order by means.number
