-- Share of refined motions that succeed under four controllers of palm and fingers, at speeds and with masses of the hand, the
-- palm lagging as that of the released simulation, and the gain of the last over PD with Student's 95 % interval over the
-- objects; the paper states only a gain (Ye et al., RA-L 2023, table IV).
--
-- pipeline run pipelines/studies/paper_tables.toml
with
    variants as (
        select run as variant, max(case when key = 'protocol.reach_s' then number end) as reach_s,
            max(case when key = 'scene.hand_mass_scale' then number end) as mass
        from settings where stage = 'screen_pd' and run in (select run from runs) group by run),
    by_object as (
        select round(0.8 / reach_s, 0) as speed, mass, object,
            100.0 * sum(case when stage = 'screen_pd' then successes_n else 0 end)
                / sum(case when stage = 'screen_pd' then candidates_n else 0 end) as pd,
            100.0 * sum(case when stage = 'screen_pd_velocity' then successes_n else 0 end)
                / sum(case when stage = 'screen_pd_velocity' then candidates_n else 0 end) as held,
            100.0 * sum(case when stage = 'screen_pd_interpolated' then successes_n else 0 end)
                / sum(case when stage = 'screen_pd_interpolated' then candidates_n else 0 end) as interpolated,
            100.0 * sum(case when stage = 'screen_pd_feedforward' then successes_n else 0 end)
                / sum(case when stage = 'screen_pd_feedforward' then candidates_n else 0 end) as feedforward
        from all_success join variants on all_success.run = variants.variant group by reach_s, mass, object),
    means as (
        select speed, mass, avg(pd) as pd, avg(held) as held, avg(interpolated) as interpolated,
            avg(feedforward) as feedforward, avg(feedforward - pd) as gain,
            case count(pd) when 15 then 2.145 else 2.093 end * stddev(feedforward - pd) / sqrt(1.0 * count(pd)) as reach
        from by_object group by speed, mass),
    paper as (
        select * from (values
            (1.0, 1.0, 5.66), (1.0, 2.0, 4.15), (1.0, 3.0, 7.10), (2.0, 1.0, 14.95), (2.0, 2.0, 7.73), (2.0, 3.0, 2.10),
            (3.0, 1.0, 4.29), (3.0, 2.0, 1.65), (3.0, 3.0, 16.77)) as paper(times, masses, paper_gain))
select
    round(speed, 0) as "speed",
    round(mass, 0) as "hand's mass",
    round(pd, 1) as "PD, %",
    round(held, 1) as "with velocity",
    round(interpolated, 1) as "at the faster rate",
    round(feedforward, 1) as "with inverse dynamics",
    round(gain, 1) as "gain",
    round(gain - reach, 1) as "from",
    round(gain + reach, 1) as "to",
    round(paper_gain, 2) as "paper's gain"
from means join paper on means.speed = paper.times and means.mass = paper.masses order by speed, mass
