-- The default options, some of them changed, and the paper's and its code's after some minutes of training:
-- 64 motions for each of 20 objects, one fold of four unseen.
--
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set train.unseen_fold=1/4
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set train.unseen_fold=1/4 \
--   --set refine.draws=1 --set sample.per_object=64
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set train.unseen_fold=1/4 \
--   --set train.training.augmentation=none
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set train.unseen_fold=1/4 \
--   --set train.network.frame=object --set train.training.augmentation=none,any
-- pipeline run pipelines/paper.toml --until screen --set ingest.root=$DEXYCB --set train.unseen_fold=1/4 \
--   --set train.unseen_objects=[] --set sample.per_object=64 \
--   --set train.training.epochs=90 --set train.training.halving_epochs=45 --set train.held_out_share=0.1 \
--   --set screen.protocol.name=table_lift --set screen.protocol.squeeze_rad=0.15
-- pipeline run pipelines/released.toml --until screen --set ingest.root=$DEXYCB --set train.unseen_fold=1/4 \
--   --set train.unseen_objects=[] --set sample.per_object=64 \
--   --set train.training.epochs=8 --set train.training.halving_epochs=4 --set train.held_out_share=0.1 \
--   --set screen.protocol.name=table_lift --set screen.protocol.squeeze_rad=0.15 \
--   --set ingest.reach=robust --set retarget.hand_table=data/hands/allegro_right_paper.toml
with
    variants as (
        select run as variant,
            max(case when key = 'training.epochs' then number end) as epochs,
            max(case when key = 'draws' then number end) as draws,
            max(case when key = 'network.frame' then value end) as frame,
            max(case when key = 'training.augmentation' then value end) as augmentation
        from settings where stage in ('train', 'refine') and run in (select run from runs) group by run),
    tips as (
        select run as tips_run,
            1000 * avg(case when split = 'training' then tip_error_mean_m end) as learned_mm,
            1000 * avg(case when split = 'held_out' then tip_error_mean_m end) as held_out_mm,
            1000 * avg(case when split = 'unseen' then tip_error_mean_m end) as unseen_mm
        from all_reconstruction where run in (select run from runs) group by run),
    drawn as (
        select run as drawn_run, 100 * avg(case when within_limits then 1.0 else 0.0 end) as within,
            100 * avg(case when approach_depth_m < 0.005 then 1.0 else 0.0 end) as clear
        from all_sampling where run in (select run from runs) group by run),
    spreads as (
        select run as spread_run,
            1000 * avg(case when metric = 'grasp_spread_m' then value end) as palm_mm,
            degrees(avg(case when metric = 'grasp_spread_rad' then value end)) as palm_deg,
            avg(case when metric = 'grasp_q_spread_rad' then value end) as q_rad
        from metrics where artifact = 'sampling' and run in (select run from runs) group by run),
    held as (
        select run as held_run, pipeline, 100.0 * sum(successes_n) / sum(candidates_n) as held
        from all_success where run in (select run from runs) group by run, pipeline)
select
    case when pipeline = 'unseen' then 'default' else '`' || pipeline || '`' end
        || case when pipeline = 'unseen' and draws = 1 then ', `refine.draws = 1`' else '' end
        || case when pipeline = 'unseen' and frame like '%object%' then ', `frame = "object"`' else '' end
        || case when pipeline = 'unseen' and augmentation <> '"vertical"'
            then ', `augmentation = ' || augmentation || '`' else '' end as "options",
    round(epochs, 0) as "epochs",
    round(learned_mm, 0) as "tips, learned, mm",
    round(held_out_mm, 0) as "held out, mm",
    round(unseen_mm, 0) as "unseen objects, mm",
    round(within, 0) as "within limits, %",
    round(clear, 0) as "not 5 mm deep, %",
    round(palm_mm, 0) as "spread: palm, mm",
    round(palm_deg, 0) as "its turn, °",
    round(q_rad, 2) as "joints, rad",
    round(held, 1) as "hold, %"
from held join variants on held.held_run = variants.variant join tips on held.held_run = tips.tips_run
    join drawn on held.held_run = drawn.drawn_run join spreads on held.held_run = spreads.spread_run
order by case when pipeline = 'unseen' then 0 else 1 end, pipeline, frame desc, augmentation desc, draws desc
