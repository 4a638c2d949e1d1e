-- Motions of the distilled function of three rounds, for codes of the whole prior and of its middle (`sample.spread`):
-- means over the objects, as `distilled.sql` counts.
--
-- pipeline run pipelines/studies/distilled_again.toml --set ingest.root=$DEXYCB --set sample.inputs.checkpoint=train_3.checkpoint --set sample.spread=0.4,0.6,0.8,1.0
with
    variants as (
        select run as of_run, case when overrides like '%spread=0.4%' then 0.4 when overrides like '%spread=0.6%' then 0.6
            when overrides like '%spread=0.8%' then 0.8 when overrides like '%spread=1.0%' then 1.0 end as spread
        from runs where run in (select run from runs)),
    by_object as (
        select spread, object, object_split, case when stage = 'screen_drawn' then 1 else 0 end as drawn,
            100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join variants on all_success.run = variants.of_run
        where stage in ('screen', 'screen_drawn') and spread is not null group by spread, object, object_split, stage),
    palms as (
        select spread, 1000 * median(mean_palm_m) as mm
        from all_sampling join variants on all_sampling.run = variants.of_run
        where stage = 'sample' and spread is not null group by spread)
select
    by_object.spread as "spread",
    round(avg(case when drawn = 1 and object_split = 'seen' then share end), 1) as "as sampled: succeed, seen, %",
    round(avg(case when drawn = 1 and object_split = 'unseen' then share end), 1) as "as sampled: succeed, unseen, %",
    round(avg(case when drawn = 0 and object_split = 'seen' then share end), 1) as "refined: succeed, seen, %",
    round(avg(case when drawn = 0 and object_split = 'unseen' then share end), 1) as "refined: succeed, unseen, %",
    round(max(mm)) as "median palm to the mean palm, mm"
from by_object join palms on by_object.spread = palms.spread
group by by_object.spread
order by by_object.spread
