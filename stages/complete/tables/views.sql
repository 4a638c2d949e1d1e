-- What an estimated shape costs: refined motions of the functions of two folds to the ten objects that they have not learned
-- from, judged on the true meshes by `full_contact`: means over the objects of the share that succeeds, of single samples and
-- of the best of 16, with Student's 95 % interval over the objects. One noisy view and the true mesh have five seeds more,
-- and so six views of each object. $FOLDS/1 and $FOLDS/2 have the files `last.*` of the artifact `train_3.checkpoint` of
-- `pipelines/studies/distilled_again.toml`, with `shared.unseen_fold` of 1/4 and of 2/4;
-- the functions of the LEAP hand learn from demonstrations alone.
--
-- pipeline run pipelines/studies/views.toml --profile fold_1 --set ingest.root=$DEXYCB --set pretrained.checkpoint=$FOLDS/1
-- pipeline run pipelines/studies/views.toml --profile fold_2 --set ingest.root=$DEXYCB --set pretrained.checkpoint=$FOLDS/2
-- pipeline run pipelines/studies/views.toml --profile fold_1 --set ingest.root=$DEXYCB --set pretrained.checkpoint=$FOLDS/1 \
--   --set seed=1,2,3,4,5 --set camera.views_n=1 --set camera.noise.level=1.0 --set complete.completion=symmetry \
--   --set camera.position_error_m=0.0 --set camera.orientation_error_rad=0.0
-- pipeline run pipelines/studies/views.toml --profile fold_2 --set ingest.root=$DEXYCB --set pretrained.checkpoint=$FOLDS/2 \
--   --set seed=1,2,3,4,5 --set camera.views_n=1 --set camera.noise.level=1.0 --set complete.completion=symmetry \
--   --set camera.position_error_m=0.0 --set camera.orientation_error_rad=0.0
-- pipeline run pipelines/studies/views_registered.toml --profile fold_1 --set ingest.root=$DEXYCB --set pretrained.checkpoint=$FOLDS/1
-- pipeline run pipelines/studies/views_registered.toml --profile fold_2 --set ingest.root=$DEXYCB --set pretrained.checkpoint=$FOLDS/2
-- pipeline run pipelines/studies/views_hand.toml --profile fold_1 --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/views_hand.toml --profile fold_2 --set ingest.root=$DEXYCB
with
    variants as (
        select run as of_run, case
            when pipeline = 'views_hand' then 80 when pipeline = 'views_registered' then 2
            when overrides like '%position_error_m=0.002"%' then 42 when overrides like '%position_error_m=0.005"%' then 45
            when overrides like '%position_error_m=0.01"%' then 50 when overrides like '%error_rad=0.0349"%' then 62
            when overrides like '%error_rad=0.0873"%' then 65 when overrides like '%error_rad=0.1745"%' then 70
            when overrides like '%"hull%' then 31 when overrides like '%"carved%' then 32
            when overrides like '%"superquadric%' then 33
            else case when overrides like '%level=0.0"%' then 0 when overrides like '%level=1.0"%' then 10 else 20 end
                + case when overrides like '%views_n=1"%' then 4 when overrides like '%views_n=2"%' then 5 else 6 end
            end as number
        from runs where run in (select run from runs)),
    by_object as (
        select case when stage not like '%true%' then number when number = 80 then 81 when number = 14 then 1 end as row_number, object,
            case when stage like '%best' then 1 else 0 end as best, 100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join variants on all_success.run = variants.of_run
        where object_split = 'unseen' group by 1, object, 3),
    names as (
        select * from (values
            (14, 'one noisy view'), (15, 'two noisy views'), (16, 'three noisy views'),
            (4, 'one view without noise'), (5, 'two views without noise'), (6, 'three views without noise'),
            (24, 'one view of twice the noise'), (25, 'two views of twice the noise'), (26, 'three views of twice the noise'),
            (31, 'one noisy view, `hull`'), (32, 'one noisy view, `carved`'), (33, 'one noisy view, `superquadric`'),
            (42, 'one noisy view, camera 2 mm off'), (45, 'one noisy view, camera 5 mm off'),
            (50, 'one noisy view, camera 10 mm off'), (62, 'one noisy view, camera 2° off'),
            (65, 'one noisy view, camera 5° off'), (70, 'one noisy view, camera 10° off'),
            (2, 'one noisy view of a known mesh'), (1, 'the true mesh'),
            (80, 'LEAP: one noisy view'), (81, 'LEAP: the true mesh')) as names(number, shown))
select
    shown as "shape",
    round(avg(case when best = 0 then share end), 1) as "single samples, %",
    round(avg(case when best = 1 then share end), 1) as "best of 16, %",
    round(greatest(0, avg(case when best = 1 then share end) - 2.262 * stddev(case when best = 1 then share end) / sqrt(10)), 1) as "from",
    round(least(100, avg(case when best = 1 then share end) + 2.262 * stddev(case when best = 1 then share end) / sqrt(10)), 1) as "to",
    round(min(case when best = 1 then share end)) as "least object, %"
from by_object join names on by_object.row_number = names.number
group by row_number, shown
order by case when row_number = 14 then 0 when row_number < 3 then 75 - row_number else row_number end
