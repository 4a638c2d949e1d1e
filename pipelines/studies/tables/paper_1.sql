-- Smoothness of the motions that succeed, as planned and as the simulated hand executed them, by the paper's definition: position
-- as is, velocity and acceleration as logarithms to base 10 (Ye et al., RA-L 2023, table I).
--
-- pipeline run pipelines/studies/paper_tables.toml
with
    -- The variants share these motions.
    newest as (
        select max(run) as newest_run from runs where pipeline = 'paper_tables' and run in (select run from runs)),
    held as (
        select s.* from all_smoothness s join newest on s.run = newest.newest_run
            join all_rollouts r on r.run = s.run and r.stage = s.stage and r.object = s.object and r.candidate_id = s.candidate_id
        where r.success and s.reached
            and s.stage in ('screen', 'screen_drawn', 'screen_rrt', 'screen_rrt_tta', 'screen_rrt_eigengrasp', 'screen_cem', 'screen_line')),
    measured as (
        select stage, 0 as place, 'planned' as motion, count(*) as n,
            avg(paper_joints_position) as q, log10(avg(paper_joints_velocity)) as dq,
            log10(avg(paper_joints_acceleration)) as ddq,
            avg(paper_cartesian_position) as x, log10(avg(paper_cartesian_velocity)) as dx,
            log10(avg(paper_cartesian_acceleration)) as ddx
        from held group by stage
        union all
        select stage, 1 as place, 'executed' as motion, count(*) as n,
            avg(executed_paper_joints_position) as q, log10(avg(executed_paper_joints_velocity)) as dq,
            log10(avg(executed_paper_joints_acceleration)) as ddq,
            avg(executed_paper_cartesian_position) as x, log10(avg(executed_paper_cartesian_velocity)) as dx,
            log10(avg(executed_paper_cartesian_acceleration)) as ddx
        from held group by stage
        union all
        select * from (values
            ('rrt', 2, 'the paper''s', 0, 3.40, 3.43, 6.47, 9.71, 3.95, 6.99),
            ('cem', 2, 'the paper''s', 0, 7.42, 3.12, 5.54, 16.36, 3.48, 5.90),
            ('cgf', 2, 'the paper''s', 0, 10.42, 2.06, 3.51, 6.69, 1.99, 3.47),
            ('line', 2, 'the paper''s', 0, 1.00, -3.58, -1.99, 1.96, 0.70, 1.38))
            as paper(stage, place, motion, n, q, dq, ddq, x, dx, ddx)),
    names as (
        select * from (values
            ('screen', 1, 'the function, refined'), ('screen_drawn', 2, 'the function, as sampled'),
            ('cgf', 2, 'the function, as sampled'), ('screen_rrt', 3, 'force closure, RRT-Connect'),
            ('screen_rrt_eigengrasp', 4, 'eigengrasps, RRT-Connect'), ('screen_rrt_tta', 5, 'GraspTTA, RRT-Connect'), ('rrt', 5, 'GraspTTA, RRT-Connect'),
            ('screen_cem', 6, 'force closure, CEM-MPC'), ('cem', 7, 'GraspTTA, CEM-MPC'),
            ('screen_line', 8, 'straight line'), ('line', 8, 'straight line')) as names(of_stage, number, shown))
select
    shown as "grasp, motion",
    motion as "as",
    case when n > 0 then cast(n as varchar) else '-' end as "motions",
    round(q, 2) as "joints: position",
    round(dq, 2) as "joints: velocity",
    round(ddq, 2) as "joints: acceleration",
    round(x, 2) as "links: position",
    round(dx, 2) as "links: velocity",
    round(ddx, 2) as "links: acceleration"
from measured join names on measured.stage = names.of_stage order by number, measured.place
