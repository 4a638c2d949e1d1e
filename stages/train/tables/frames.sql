-- The frame of the network and the rotations in its training: share of 64 motions for each of the 15 seen and
-- 5 unseen objects (one fold of four) that holds, with the object at its expected pose, and displaced and rotated.
--
-- pipeline run pipelines/frames.toml --set ingest.root=$DEXYCB --set train.unseen_fold=1/4
with
    variants as (
        select run as variant,
            max(case when key = 'network.frame' then replace(value, '"', '`') end) as frame,
            max(case when key = 'training.augmentation' then replace(value, '"', '`') end) as augmentation,
            max(case when key = 'scene.object_offset.x_m' then number end) as offset_m
        from settings where stage in ('train', 'screen') and run in (select run from runs) group by run),
    by_object as (
        select frame, augmentation, offset_m, case when object_split = 'unseen' then 1 else 0 end as is_unseen,
            candidates_n, successes_n
        from all_success join variants on all_success.run = variants.variant),
    shares as (
        select frame, augmentation, offset_m,
            100.0 * sum((1 - is_unseen) * successes_n) / sum((1 - is_unseen) * candidates_n) as seen,
            100.0 * sum(is_unseen * successes_n) / sum(is_unseen * candidates_n) as unseen
        from by_object group by frame, augmentation, offset_m),
    by_offset as (
        select frame, augmentation,
            max(case when offset_m = 0 then seen end) as seen_0,
            max(case when offset_m = 0.01 then seen end) as seen_10,
            max(case when offset_m = 0.02 then seen end) as seen_20,
            max(case when offset_m = 0 then unseen end) as unseen_0,
            max(case when offset_m = 0.01 then unseen end) as unseen_10,
            max(case when offset_m = 0.02 then unseen end) as unseen_20
        from shares group by frame, augmentation)
select
    frame || ', ' || augmentation || case
        when frame like '%resting%' and augmentation like '%vertical%' then ' (default)'
        when frame like '%object%' and augmentation like '%any%' then ' (the paper''s way)'
        else '' end as "frame, augmentation",
    round(seen_0, 0) as "in place, %",
    round(seen_10, 0) as "10 mm, 0.1 rad, %",
    round(seen_20, 0) as "20 mm, 0.2 rad, %",
    round(unseen_0, 0) as "unseen, in place, %",
    round(unseen_10, 0) as "unseen, 10 mm, 0.1 rad, %",
    round(unseen_20, 0) as "unseen, 20 mm, 0.2 rad, %"
from by_offset order by frame desc, augmentation desc
