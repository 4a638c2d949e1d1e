-- Demonstrations carried out unchanged, and motions sampled by a model that has seen 15 of the 20 objects.
-- The 95 % interval is that of the objects' mean, by resampling objects.
--
-- pipeline run pipelines/replay.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set sample.per_object=500
select
    case when pipeline = 'replay' then 'demonstrations' when origin = 'all' then 'sampled, all codes'
        else 'sampled, ' || origin end as "motions",
    objects_n || case when object_split = '' then '' else ' ' || object_split end as "objects",
    draws_n as "draws",
    candidates_n as "candidates",
    round(100 * candidate_rate, 1) as "hold by candidate, %",
    round(100 * draw_rate, 1) as "by draw, %",
    round(100 * candidate_rate_mean, 1) as "objects' mean, %",
    round(100 * candidate_rate_low, 1) as "from, %",
    round(100 * candidate_rate_high, 1) as "to, %"
from all_rates
where run in (select run from runs) and (pipeline <> 'replay' or origin = 'all')
order by pipeline, object_split, origin
