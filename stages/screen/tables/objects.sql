-- Motions sampled for each object by a model that has seen 15 of the 20, the number that fails by each
-- reason, and beside them the share of the object's demonstrations that hold.
--
-- pipeline run pipelines/replay.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set sample.per_object=500
with
    unseen as (
        select distinct object as name, ' (unseen)' as mark from all_reconstruction
        where split = 'unseen' and run in (select run from runs)),
    sampled as (
        select *, object as sampled_object from all_success where pipeline = 'unseen' and run in (select run from runs)),
    replayed as (
        select object as demonstrated, rate as demonstrated_rate from all_success
        where pipeline = 'replay' and run in (select run from runs))
select
    replace(substr(sampled_object, 5), '_', ' ') || coalesce(mark, '') as "object",
    round(100 * rate, 0) as "hold, %",
    not_grasped_n as "not grasped",
    table_n as "table",
    early_contact_n as "early contact",
    knocked_over_n as "knocked over",
    dropped_n + slipped_n as "dropped, slipped",
    too_deep_n as "too deep",
    limit_n + diverged_n as "limit, diverged",
    round(100 * demonstrated_rate, 0) as "demonstrations hold, %"
from sampled left join unseen on sampled.sampled_object = unseen.name
    left join replayed on sampled.sampled_object = replayed.demonstrated
order by sampled_object
