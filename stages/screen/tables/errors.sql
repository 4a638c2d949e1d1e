-- Share of all refined motions for the bundled objects, accepted or not, that succeeds with one error of a known size:
-- the objects' mean, with its 95 % interval by resampling objects, and the difference to no error, paired by object, with
-- Student's 95 % interval over the 15 objects.
--
-- pipeline run pipelines/studies/errors.toml
with
    errors as (
        select run as of_run,
            round(1000 * max(case when key = 'pose_error.position_m' then number end), 0) as off_mm,
            round(57.2958 * max(case when key = 'pose_error.yaw_rad' then number end), 0) as off_deg,
            max(case when key = 'scene.friction' then number end) as friction,
            max(case when key = 'scene.mass_scale' then number end) as mass,
            max(case when key = 'scene.drive.torque_limit' then number end) as torque
        from settings where stage = 'screen' and run in (select run from runs) group by run),
    named as (
        select of_run, off_mm, off_deg,
            case when friction < 0.8 then 1 when mass > 1 then 2 when torque < 0.7 then 3 else 0 end as place
        from errors),
    by_object as (
        select of_run, off_mm, off_deg, place, object, sum(1.0 * candidates_n) as n,
            100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join named on all_success.run = of_run group by of_run, off_mm, off_deg, place, object),
    ends as (
        select run as rated, candidate_rate_low as low, candidate_rate_high as high from all_rates where origin = 'all'),
    without as (select object as same, share as whole from by_object where off_mm + off_deg + place = 0)
select
    case when place = 1 then 'friction 0.5 instead of 0.8' when place = 2 then 'mass 25 % larger'
        when place = 3 then 'torque limit 0.5 instead of 0.7 Nm' when off_mm + off_deg = 0 then 'none'
        when off_deg = 0 then 'object ' || cast(off_mm as bigint) || ' mm off'
        when off_mm = 0 then 'object ' || cast(off_deg as bigint) || '° off'
        else 'object ' || cast(off_mm as bigint) || ' mm and ' || cast(off_deg as bigint) || '° off' end as "error",
    cast(sum(n) as bigint) as "motions",
    round(avg(share), 1) as "succeed, %",
    round(100 * max(low), 0) as "from",
    round(100 * max(high), 0) as "to",
    round(avg(share - whole), 1) as "difference",
    round(avg(share - whole) - 2.145 * stddev(share - whole) / sqrt(15.0), 0) as "at least",
    round(avg(share - whole) + 2.145 * stddev(share - whole) / sqrt(15.0), 0) as "at most"
from by_object join without on object = same join ends on of_run = rated
group by off_mm, off_deg, place
order by place, off_deg > 0, off_mm, off_deg
