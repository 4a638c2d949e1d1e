-- How different the grasps that succeed are, of an object that lies alike: refined single samples of the prior beside the
-- retargeted demonstrations: root mean square distances from their mean (`success`), over the objects weighted by grasps.
--
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/refinement.toml --profile table_lift --set ingest.root=$DEXYCB --set seed=1 \
--   --set sample.per_object=20 --set refine.draws=1
with
    of_objects as (
        select case when pipeline = 'replay' then 'demonstrations' when object_split = 'unseen' then 'refined, unseen objects'
                else 'refined, seen objects' end as motions,
            object, 1.0 * spread_n as n, spread_palm_m as palm_m, spread_palm_rad as palm_rad, spread_q_rad as q_rad
        from all_success where run in (select run from runs) and spread_n > 0)
select
    motions as "motions",
    round(sum(n), 0) as "grasps",
    round(1000 * sqrt(sum(n * palm_m * palm_m) / sum(n)), 0) as "palm, mm",
    round(degrees(sqrt(sum(n * palm_rad * palm_rad) / sum(n))), 0) as "its turn, °",
    round(sqrt(sum(n * q_rad * q_rad) / sum(n)), 2) as "joints, rad"
from of_objects group by motions order by motions
