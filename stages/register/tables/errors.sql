-- Poses of DexYCB's 20 objects from one depth image, each in eight poses and from eight sides, with the camera's usual errors
-- and with twice as large ones. A pose is wrong if the surface is more than 3 mm from where it is, in the mean.
--
-- pipeline run pipelines/registered.toml --until register --set ingest.root=$DEXYCB --set camera.noise.level=1.0,2.0 --set seed=1,2,3,4,5,6,7,8
with
    levels as (
        select run, number as level from settings
        where run in (select run from runs) and stage = 'camera' and key = 'noise.level'),
    results as (
        select run, count(*) as views_n, sum(case when result = 'made' then 1 else 0 end) as found_n
        from units where run in (select run from runs) and stage = 'register' and artifact = 'objects' group by run),
    errors as (
        select run,
            sum(case when metric = 'surface_error_m' and value > 0.003 then 1 else 0 end) as wrong_n,
            avg(case when metric = 'surface_error_m' then 1000 * value end) as surface_mm,
            max(case when metric = 'surface_error_m' then 1000 * value end) as most_mm,
            avg(case when metric = 'position_error_m' then 1000 * value end) as position_mm,
            avg(case when metric = 'tilt_rad' then degrees(value) end) as tilt
        from metrics where run in (select run from runs) and stage = 'register' and artifact = 'objects' group by run)
select
    case when level > 1 then 'twice' else 'usual' end as "errors of the camera",
    sum(views_n) as "images",
    sum(found_n - wrong_n) as "right",
    sum(wrong_n) as "wrong",
    sum(views_n - found_n) as "refused",
    round(avg(surface_mm), 1) as "surface off, mm",
    round(max(most_mm), 1) as "most, mm",
    round(avg(position_mm), 1) as "middle off, mm",
    round(avg(tilt), 1) as "tilt off, degrees"
from levels join results on levels.run = results.run join errors on levels.run = errors.run
group by level
order by level
