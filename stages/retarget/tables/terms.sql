-- What each term of the objective and each option is worth, on demonstrations carried out unchanged. All
-- columns but the success rates are means over the objects' figures; depths, gaps and the share of hands
-- more than 3 mm below the table are those of the grasp.
--
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.contact_weight=0
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.object_weight=0
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.clearance_m=0
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.table_weight=0
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.contact_weight=0 --set retarget.object_weight=0 --set retarget.table_weight=0
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.hand_table=stages/retarget/tables/allegro_right_scale_1.0.toml,stages/retarget/tables/allegro_right_scale_1.2.toml
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.smoothing_s=0.05
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.loss=smooth_l1
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB --set screen.protocol.approach=open,follow \
--   --set retarget.wrist=fixed
with
    named as (
        select run as variant, case when overrides like '%follow%' then 1 else 0 end as follows,
            case
                when overrides like '%contact_weight%object_weight%' then '5 landmarks alone (none of them)'
                when overrides like '%contact_weight%' then '1 without `contact_weight`'
                when overrides like '%object_weight%' then '2 without `object_weight`'
                when overrides like '%clearance_m%' then '3 without `clearance_m`'
                when overrides like '%table_weight%' then '4 without `table_weight`'
                when overrides like '%scale_1.0%' then '6 a hand with `scale = 1.0`'
                when overrides like '%scale_1.2%' then '7 a hand with `scale = 1.2`'
                when overrides like '%smoothing_s%' then '8 `smoothing_s = 0.05`'
                when overrides like '%smooth_l1%' then '9 `loss = "smooth_l1"`'
                when overrides like '%wrist%' then 'A `wrist = "fixed"`'
                else '0 all terms, the default' end as name
        from runs where run in (select run from runs)),
    screened as (
        select name, 100.0 * sum((1 - follows) * successes_n) / sum((1 - follows) * candidates_n) as held,
            100.0 * sum(follows * successes_n) / sum(follows * candidates_n) as held_following
        from all_success join named on all_success.run = named.variant group by name),
    tracked as (
        select name as tracked_name, 1000 * avg(tip_error_mean_m) as mean_mm,
            1000 * avg(tip_error_median_m) as median_mm, 1000 * avg(tip_error_p95_m) as p95_mm,
            1000 * avg(contact_gap_median_m) as gap_mm, 1000 * avg(contact_gap_p90_m) as gap_p90_mm,
            1000 * avg(penetration_median_m) as depth_mm, 1000 * avg(penetration_p90_m) as depth_p90_mm,
            100 * avg(below_table_share) as below
        from all_tracking join named on all_tracking.run = named.variant group by name)
select
    substr(name, 3) as "retargeting",
    round(held, 1) as "succeed, %",
    round(held_following, 1) as "succeed, following the motion, %",
    round(mean_mm, 1) as "tip to landmark, mm: mean",
    round(median_mm, 1) as "median",
    round(p95_mm, 0) as "p95",
    round(gap_mm, 2) as "touching tip to surface, mm: median",
    round(gap_p90_mm, 1) as "gap, p90",
    round(depth_mm, 2) as "depth in the object, mm: median",
    round(depth_p90_mm, 1) as "depth, p90",
    round(below, 1) as "below the table, %"
from screened join tracked on screened.name = tracked.tracked_name order by name
