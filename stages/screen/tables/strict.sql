-- Share of the refined motions for the bundled objects that succeeds with all strict conditions, without each of
-- them and without any, and the control steps simulated for each motion.
--
-- pipeline run pipelines/studies/strict.toml --profile table_lift
with
    variants as (
        select run as variant,
            max(case when key = 'protocol.strict.min_fingers' then number end) as fingers,
            max(case when key = 'protocol.strict.max_spin_rad_per_s' then number end) as spin,
            max(case when key = 'protocol.strict.palm_table_tolerance_m' then number end) as palm,
            max(case when key = 'protocol.strict.start_tolerance_m' then number end) as start,
            max(case when key = 'max_penetration_m' then number end) as depth,
            max(case when key = 'protocol.strict.knocked_until' and value like '%lift%' then 1 else 0 end) as knocked,
            max(case when key = 'protocol.strict.max_palm_force_n' then number end) as force,
            max(case when key = 'scene.fingers_touch' and value = 'true' then 1 else 0 end) as touch
        from settings where stage = 'screen' and run in (select run from runs) group by run),
    named as (
        select variant, case
            when fingers = 0 and depth = 1 then 9
            when force = 50 then 7
            when touch = 1 then 8
            when knocked = 1 then 6
            when fingers = 0 then 1
            when spin = 1000 then 2
            when palm = 0.01 then 3
            when start = 0.02 then 4
            when depth = 1 then 5
            else 0 end as place
        from variants),
    names as (
        select * from (values
            (0, 'all'), (1, 'without `min_fingers`'), (2, 'without `max_spin_rad_per_s`'),
            (3, 'without `palm_table_tolerance_m`'), (4, 'without `start_tolerance_m`'),
            (5, 'without `max_penetration_m`'), (6, 'with `knocked_until = "lift"`'),
            (7, 'with `max_palm_force_n = 50`, `max_palm_torque_nm = 10`'), (8, 'with `fingers_touch`'), (9, 'none'))
            as names(number, conditions)),
    sums as (
        select place, sum(candidates_n) as n, 100.0 * sum(successes_n) / sum(candidates_n) as held,
            1.0 * sum(control_steps_n) / sum(candidates_n) as steps
        from all_success join named on all_success.run = named.variant group by place)
select
    conditions as "conditions",
    n as "motions",
    round(held, 1) as "succeed, %",
    round(steps, 1) as "control steps a motion"
from sums join names on sums.place = names.number
order by place
