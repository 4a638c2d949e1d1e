-- Motions that succeed at the simulated cell, whose physics are other than the screen's and whose errors are sampled anew, of
-- the first accepted ones, for the paper's six objects and over all: the counterpart, simulated, of its trials on a robot (Ye
-- et al., RA-L 2023, table III).
--
-- pipeline run pipelines/studies/paper_tables.toml
with
    -- The variants share these motions.
    newest as (
        select max(run) as newest_run from runs where pipeline = 'paper_tables' and run in (select run from runs)),
    sent as (
        select stage, object, 1.0 * count(*) as n, 1.0 * sum(case when outcome = 'succeeded' then 1 else 0 end) as held
        from all_executions join newest on all_executions.run = newest.newest_run group by stage, object),
    sums as (
        select stage, sum(n) as n, sum(held) as held,
            max(case when object = '011_banana' then 100 * held / n end) as banana,
            max(case when object = '021_bleach_cleanser' then 100 * held / n end) as cleanser,
            max(case when object = '010_potted_meat_can' then 100 * held / n end) as meat,
            max(case when object = '005_tomato_soup_can' then 100 * held / n end) as soup,
            max(case when object = '006_mustard_bottle' then 100 * held / n end) as bottle,
            max(case when object = '056_tennis_ball' then 100 * held / n end) as ball
        from sent group by stage
        union all
        select * from (values
            ('cgf', 0.0, 0.0, 70.0, 85.0, 70.0, 80.0, 85.0, 65.0), ('rrt', 0.0, 0.0, 10.0, 15.0, 10.0, 5.0, 5.0, 10.0),
            ('gi', 0.0, 0.0, 60.0, 65.0, 50.0, 50.0, 65.0, 40.0), ('cem', 0.0, 0.0, 10.0, 10.0, 15.0, 5.0, 0.0, 15.0))
            as paper(stage, n, held, banana, cleanser, meat, soup, bottle, ball)),
    names as (
        select * from (values
            ('dispatch', 1, 'the function, refined'), ('dispatch_rrt', 3, 'force closure, RRT-Connect'),
            ('dispatch_rrt_eigengrasp', 4, 'eigengrasps, RRT-Connect'), ('dispatch_cem', 8, 'force closure, CEM-MPC'),
            ('cgf', 2, 'the paper''s function, robot'), ('rrt', 7, 'the paper''s GraspTTA, RRT, robot'),
            ('dispatch_rrt_tta', 6, 'GraspTTA, RRT-Connect'), ('gi', 5, 'the paper''s GraspIt, RRT, robot'), ('cem', 9, 'the paper''s GraspTTA, CEM-MPC, robot')) as names(of_stage, number, shown))
select
    shown as "grasp, motion",
    round(banana, 0) as "banana, %",
    round(cleanser, 0) as "cleanser",
    round(meat, 0) as "meat can",
    round(soup, 0) as "soup can",
    round(bottle, 0) as "bottle",
    round(ball, 0) as "ball",
    case when n > 0 then cast(cast(held as int) as varchar) || ' of ' || cast(cast(n as int) as varchar) else '-' end
        as "all objects"
from sums join names on sums.stage = names.of_stage order by number
