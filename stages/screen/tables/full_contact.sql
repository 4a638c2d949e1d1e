-- Share of the refined motions for the bundled objects that succeeds from `table_lift` to `full_contact`, one contact
-- more in each row, without and with fingers that refinement keeps apart.
--
-- pipeline run pipelines/studies/full_contact.toml
with
    variants as (
        select run as variant,
            max(case when stage = 'refine' and key = 'self_collision_weight' then number end) as apart,
            max(case when stage = 'screen' and key = 'scene.friction' then number end) as friction,
            max(case when stage = 'screen' and key = 'scene.fingers_touch' and value = 'true' then 1 else 0 end) as touch,
            max(case when stage = 'screen' and key = 'scene.fingers_touch_palm' and value = 'true' then 1 else 0 end) as palm,
            max(case when stage = 'screen' and key = 'protocol.name' and value like '%full_contact%' then 1 else 0 end) as whole
        from settings where run in (select run from runs) group by run),
    named as (
        select variant, case when apart > 0 then 5 + whole when whole = 1 then 4 when palm = 1 then 3
            when touch = 1 then 2 when friction = 0.8 then 1 else 0 end as place
        from variants),
    names as (
        select * from (values
            (0, '`table_lift`, friction 1'), (1, '`table_lift`, friction 0.8'), (2, 'the same, fingers touch each other'),
            (3, 'the same, and the palm'), (4, '`full_contact`: the same, the arm yields, `knocked_until = "lift"`'),
            (5, '`table_lift`, friction 1; refined with `self_collision_weight = 1`'),
            (6, '`full_contact`; refined with `self_collision_weight = 1`'))
            as names(number, judged)),
    sums as (
        select place, count(*) as n, 100.0 * avg(case when success then 1 else 0 end) as held,
            1000.0 * max(case when success then finger_penetration_m end) as deepest
        from all_rollouts join named on all_rollouts.run = named.variant group by place)
select
    judged as "judged by",
    n as "motions",
    round(held, 1) as "succeed, %",
    round(deepest, 1) as "fingers in each other at most, mm"
from sums join names on sums.place = names.number
order by place
