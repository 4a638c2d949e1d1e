-- How smooth the refined motions for the bundled objects are, by three definitions, and the paper's motions
-- (Ye et al., RA-L 2023, table I): position as is, velocity and acceleration as logarithms to base 10.
--
-- pipeline run pipelines/feedforward.toml
with
    -- The motions are the same in every run at this speed.
    motions as (
        select * from all_rollouts where run in (select run from runs) and run in (
            select run from settings where key = 'protocol.reach_s' and number = 0.8)),
    measured as (
        select 0 as place, 'the paper''s' as definition,
            avg(paper_joints_position) as q, log10(avg(paper_joints_velocity)) as dq,
            log10(avg(paper_joints_acceleration)) as ddq,
            avg(paper_cartesian_position) as x, log10(avg(paper_cartesian_velocity)) as dx,
            log10(avg(paper_cartesian_acceleration)) as ddx
        from motions
        union all
        select 1 as place, 'the released code''s' as definition,
            avg(released_joints_position) as q, log10(avg(released_joints_velocity)) as dq,
            log10(avg(released_joints_acceleration)) as ddq,
            avg(released_cartesian_position) as x, log10(avg(released_cartesian_velocity)) as dx,
            log10(avg(released_cartesian_acceleration)) as ddx
        from motions
        union all
        select 2 as place, 'robust' as definition,
            avg(robust_joints_position) as q, log10(avg(robust_joints_velocity)) as dq,
            log10(avg(robust_joints_acceleration)) as ddq,
            avg(robust_cartesian_position) as x, log10(avg(robust_cartesian_velocity)) as dx,
            log10(avg(robust_cartesian_acceleration)) as ddx
        from motions
        union all
        select * from (values
            (3, 'the paper''s figures for its motions', 10.42, 2.06, 3.51, 6.69, 1.99, 3.47),
            (4, 'the paper''s figures for a straight line', 1.00, -3.58, -1.99, 1.96, 0.70, 1.38))
            as paper(place, definition, q, dq, ddq, x, dx, ddx))
select
    definition as "definition",
    round(q, 2) as "joints: position",
    round(dq, 2) as "joints: velocity",
    round(ddq, 2) as "joints: acceleration",
    round(x, 2) as "links: position",
    round(dx, 2) as "links: velocity",
    round(ddx, 2) as "links: acceleration"
from measured order by place
