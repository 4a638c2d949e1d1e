-- What the function of `distilled.toml` before its first round owes to the number of shapes, to the motions learned of each
-- and to parts of the network, with as many steps of training: single samples of the prior as `distilled.sql` counts, and the
-- diversity and smoothness of motions as sampled. Fifteen objects are seen and five unseen, by the second fold; one seed.
--
-- pipeline run pipelines/studies/curves.toml --set ingest.root=$DEXYCB
with
    variants as (
        select run as of_run, case
            when overrides like '%shapes.count=0"%' then 2 when overrides like '%shapes.count=50"%' then 3
            when overrides like '%accepted_per_object=16"%' then 4
            when overrides like '%local_points=0"%' then 5 when overrides like '%normal%' then 6
            when overrides like '%decoder_widths=[256%' then 7 else 1 end as number
        from runs where run in (select run from runs)),
    by_object as (
        select number, object, object_split, case when stage = 'screen_drawn' then 1 else 0 end as drawn,
            100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join variants on all_success.run = variants.of_run
        where stage in ('screen', 'screen_drawn') group by number, object, object_split, stage),
    palms as (
        select number as of_number, 1000 * median(mean_palm_m) as mm
        from all_sampling join variants on all_sampling.run = variants.of_run where stage = 'sample' group by number),
    names as (
        select * from (values (1, '200 shapes, 32 motions of each'), (2, 'no shapes'), (3, '50 shapes'),
            (4, '16 motions of each shape'), (5, 'without the second decoder'), (6, 'a normal prior, `kl_weight` 2e-3'),
            (7, 'widths of 256, 512 and 256')) as names(number, shown))
select
    shown as "learned from",
    round(avg(case when drawn = 1 and object_split = 'seen' then share end), 1) as "as sampled: succeed, seen, %",
    round(avg(case when drawn = 1 and object_split = 'unseen' then share end), 1) as "as sampled: succeed, unseen, %",
    round(avg(case when drawn = 0 and object_split = 'seen' then share end), 1) as "refined: succeed, seen, %",
    round(avg(case when drawn = 0 and object_split = 'unseen' then share end), 1) as "refined: succeed, unseen, %",
    round(max(mm)) as "median palm to the mean palm, mm"
from by_object join names on by_object.number = names.number join palms on by_object.number = palms.of_number
group by by_object.number, shown
order by by_object.number
