-- Share of the motions sampled for the bundled objects that holds with noise on the object's points or on
-- its pose, and control steps per held motion, as logarithm to base 10, beside the paper's (Ye et al.,
-- RA-L 2023, table V).
--
-- pipeline run pipelines/noise.toml
with
    noise as (
        select run as noise_run, 'screen_points' as screen, number as s from settings
        where stage = 'sample_noisy' and key = 'point_noise' and run in (select run from runs)
        union all
        select run as noise_run, 'screen_pose' as screen, number as s from settings
        where stage = 'screen_pose' and key = 'pose_noise' and run in (select run from runs)),
    by_object as (
        select screen, s, case when object_split = 'unseen' then 1 else 0 end as is_unseen,
            candidates_n, successes_n, control_steps_n
        from all_success join noise on all_success.run = noise.noise_run and all_success.stage = noise.screen),
    sums as (
        select replace(screen, 'screen_', '') as noise_on, s,
            1.0 * sum((1 - is_unseen) * candidates_n) as seen_n, sum((1 - is_unseen) * successes_n) as seen_held,
            sum((1 - is_unseen) * control_steps_n) as seen_steps,
            1.0 * sum(is_unseen * candidates_n) as unseen_n, sum(is_unseen * successes_n) as unseen_held,
            sum(is_unseen * control_steps_n) as unseen_steps
        from by_object group by screen, s),
    paper as (
        select * from (values
            ('points', 0.0, '4.30', '4.19'), ('points', 0.001, '4.28', '4.26'), ('points', 0.01, '4.32', '4.38'),
            ('points', 0.1, '4.39', '4.67'), ('points', 1.0, '4.61', '4.89'),
            ('pose', 0.0, '4.30', '4.19'), ('pose', 0.001, '4.31', '4.38'), ('pose', 0.01, '4.38', '4.56'),
            ('pose', 0.1, '4.48', '5.64'), ('pose', 1.0, '-', '-')) as paper(what, size, paper_seen, paper_unseen))
select
    noise_on as "noise on",
    s as "s",
    round(100 * seen_held / seen_n, 1) as "seen: hold, %",
    round(case when seen_held > 0 then log10(1.0 * seen_steps / seen_held) end, 2) as "seen: cost",
    paper_seen as "seen: paper's",
    round(100 * unseen_held / unseen_n, 1) as "unseen: hold, %",
    round(case when unseen_held > 0 then log10(1.0 * unseen_steps / unseen_held) end, 2) as "unseen: cost",
    paper_unseen as "unseen: paper's"
from sums join paper on sums.noise_on = paper.what and sums.s = paper.size
order by noise_on, s
