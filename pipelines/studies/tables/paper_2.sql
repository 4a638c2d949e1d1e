-- Share of motions that succeed, and what a success costs: control steps (every trial at full length, as the paper counts them,
-- and as simulated), collision checks, and processor seconds of making the grasp, planning or refining, and physics (Ye et
-- al., RA-L 2023, table II). Means over objects with Student's 95 % interval.
--
-- pipeline run pipelines/studies/paper_tables.toml
with
    -- The variants share these motions.
    newest as (
        select max(run) as newest_run from runs where pipeline = 'paper_tables' and run in (select run from runs)),
    screened as (
        select stage, object, object_split, success, control_steps_n, skipped_steps_n
        from all_rollouts join newest on all_rollouts.run = newest.newest_run where stage in
            ('screen', 'screen_drawn', 'screen_rrt', 'screen_rrt_tta', 'screen_rrt_eigengrasp', 'screen_cem', 'screen_line')),
    splits as (
        select object as split_object, max(object_split) as split from screened where stage = 'screen' group by object),
    tried as (
        select stage, object, count(*) as n, sum(cast(success as int)) as held, sum(control_steps_n) as steps,
            sum(control_steps_n + skipped_steps_n) as full_steps
        from screened group by stage, object),
    -- The stages whose work a motion of each row took.
    work as (
        select * from (values
            ('screen', 'refine'), ('screen', 'screen'), ('screen_drawn', 'screen_drawn'),
            ('screen_line', 'refine'), ('screen_line', 'screen_line'),
            ('screen_rrt', 'force_closure'), ('screen_rrt', 'rrt'), ('screen_rrt', 'screen_rrt'),
            ('screen_rrt_eigengrasp', 'eigengrasp'), ('screen_rrt_eigengrasp', 'rrt_eigengrasp'),
            ('screen_rrt_eigengrasp', 'screen_rrt_eigengrasp'),
            ('screen_rrt_tta', 'rrt_tta'), ('screen_rrt_tta', 'screen_rrt_tta'),
            ('screen_cem', 'cem_mpc'), ('screen_cem', 'screen_cem')) as work(of_screen, by_stage)),
    spent as (
        select of_screen, partition as spent_object,
            sum(case when metric = 'cpu_s' then value else 0 end) as cpu_s,
            sum(case when metric = 'checks' then value else 0 end) as checks,
            sum(case when metric = 'searched_steps' then value else 0 end) as searched_steps
        from metrics join newest on metrics.run = newest.newest_run join work on metrics.stage = work.by_stage
        where artifact in ('candidates', 'rollouts') group by of_screen, partition),
    by_object as (
        select stage, split, object, n, held, steps, full_steps, cpu_s, checks, searched_steps,
            100.0 * held / n as share
        from tried join splits on tried.object = splits.split_object
            join spent on tried.stage = spent.of_screen and tried.object = spent.spent_object),
    sums as (
        select stage, split, count(share) as objects_n, sum(n) as n, sum(held) as held, avg(share) as share,
            -- Too few objects have no interval.
            case when count(share) >= 5 then case count(share) when 5 then 2.776 when 10 then 2.262 when 15 then 2.145 else 2.093 end end
                * stddev(share) / sqrt(1.0 * count(share)) as reach,
            sum(steps) + sum(searched_steps) as steps, sum(full_steps) + sum(searched_steps) as full_steps,
            sum(checks) as checks, sum(cpu_s) as cpu_s
        from by_object group by stage, split),
    names as (
        select * from (values
            ('screen', 1, 'the function, refined', '-', '-'),
            ('screen_drawn', 2, 'the function, as sampled', '4.30, 11.70', '4.19, 8.31'),
            ('screen_rrt', 3, 'force closure, RRT-Connect', '-', '-'),
            ('screen_rrt_eigengrasp', 4, 'eigengrasps, RRT-Connect', '-', '-'),
            ('screen_rrt_tta', 5, 'GraspTTA, RRT-Connect', '5.30, 56.61', '4.97, 41.47'),
            ('screen_cem', 6, 'force closure, CEM-MPC', '5.85, 146.78', '5.58, 123.48'),
            ('screen_line', 7, 'straight line', 'none', 'none')) as names(of_stage, number, shown, seen, unseen))
select
    shown as "grasp, motion",
    cast(objects_n as varchar) || ' ' || split as "objects",
    n as "tried",
    round(share, 1) as "succeed, %",
    case when reach >= 0 then cast(cast(round(greatest(share - reach, 0.0), 0) as int) as varchar) else '-' end as "from",
    case when reach >= 0 then cast(cast(round(least(share + reach, 100.0), 0) as int) as varchar) else '-' end as "to",
    case when held > 0 then cast(round(log10(1.0 * full_steps / held), 2) as varchar) else '-' end as "control steps, full",
    case when held > 0 then cast(round(log10(1.0 * steps / held), 2) as varchar) else '-' end as "as simulated",
    case when held > 0 and checks > 0 then cast(round(log10(1.0 * checks / held), 2) as varchar) else '-' end as "checks",
    -- The processor time of GraspTTA is not measured by object.
    case when held > 0 and stage <> 'screen_rrt_tta' then cast(round(cpu_s / held, 2) as varchar) else '-' end as "CPU, s",
    case when split = 'seen' then seen else unseen end as "the paper's: cost, s"
from sums join names on sums.stage = names.of_stage order by number, split
