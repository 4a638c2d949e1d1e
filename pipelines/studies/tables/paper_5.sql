-- Share of motions as sampled that succeed with noise of s times the object's extent on its points or on its place, new for each
-- motion, and control steps per success, every trial at full length, as logarithm to base 10, beside the paper's (Ye et al.,
-- RA-L 2023, table V).
--
-- pipeline run pipelines/studies/paper_tables.toml
with
    noise as (
        select run as noise_run, 'screen_points' as screen, number as s from settings
        where stage = 'sample_noisy' and key = 'point_noise' and run in (select run from runs)
        union all
        select run as noise_run, 'screen_pose' as screen, number as s from settings
        where stage = 'screen_pose' and key = 'pose_noise' and run in (select run from runs)),
    by_object as (
        select screen, s, object, max(object_split) as split, 1.0 * count(*) as n, 1.0 * sum(cast(success as int)) as held,
            1.0 * sum(control_steps_n + skipped_steps_n) as steps
        from all_rollouts join noise on all_rollouts.run = noise.noise_run and all_rollouts.stage = noise.screen
        group by screen, s, object),
    means as (
        select screen, s, split, 100 * avg(held / n) as share, sum(steps) as steps, sum(held) as held,
            case count(n) when 5 then 2.776 when 10 then 2.262 when 15 then 2.145 else 2.093 end
                * 100 * stddev(held / n) / sqrt(1.0 * count(n)) as reach
        from by_object group by screen, s, split),
    both as (
        select screen, s,
            max(case when split = 'seen' then share end) as seen, max(case when split = 'seen' then reach end) as seen_reach,
            max(case when split = 'seen' and held > 0 then log10(steps / held) end) as seen_cost,
            max(case when split = 'unseen' then share end) as unseen,
            max(case when split = 'unseen' then reach end) as unseen_reach,
            max(case when split = 'unseen' and held > 0 then log10(steps / held) end) as unseen_cost
        from means group by screen, s),
    paper as (
        select * from (values
            ('screen_points', 0.0, '4.30', '4.19'), ('screen_points', 0.001, '4.28', '4.26'),
            ('screen_points', 0.01, '4.32', '4.38'), ('screen_points', 0.1, '4.39', '4.67'),
            ('screen_points', 1.0, '4.61', '4.89'), ('screen_pose', 0.0, '4.30', '4.19'),
            ('screen_pose', 0.001, '4.31', '4.38'), ('screen_pose', 0.01, '4.38', '4.56'),
            ('screen_pose', 0.1, '4.48', '5.64'), ('screen_pose', 1.0, '-', '-'))
            as paper(what, size, paper_seen, paper_unseen))
select
    replace(screen, 'screen_', '') as "noise on",
    s as "s",
    round(seen, 1) as "seen: succeed, %",
    round(greatest(seen - seen_reach, 0.0), 0) as "from",
    round(least(seen + seen_reach, 100.0), 0) as "to",
    round(seen_cost, 2) as "cost",
    paper_seen as "paper's",
    round(unseen, 1) as "unseen: succeed, %",
    round(greatest(unseen - unseen_reach, 0.0), 0) as "unseen: from",
    round(least(unseen + unseen_reach, 100.0), 0) as "unseen: to",
    round(unseen_cost, 2) as "unseen: cost",
    paper_unseen as "unseen: paper's"
from both join paper on both.screen = paper.what and both.s = paper.size order by "noise on", s
