-- Share of the refined motions for the bundled objects that holds, the hand following the whole motion, with
-- PD alone and with feedforward; the paper states only the gain (Ye et al., RA-L 2023, table IV).
--
-- pipeline run pipelines/feedforward.toml
with
    variants as (
        select run as variant, max(case when key = 'protocol.reach_s' then number end) as reach_s,
            max(case when key = 'scene.hand_mass_scale' then number end) as mass,
            max(case when value like '%feedforward%' then 1 else 0 end) as looks_ahead
        from settings where stage = 'screen' and run in (select run from runs) group by run),
    sums as (
        select round(0.8 / reach_s, 0) as speed, mass,
            100.0 * sum((1 - looks_ahead) * successes_n) / sum((1 - looks_ahead) * candidates_n) as pd,
            100.0 * sum(looks_ahead * successes_n) / sum(looks_ahead * candidates_n) as ahead
        from all_success join variants on all_success.run = variants.variant group by reach_s, mass),
    paper as (
        select * from (values
            (1.0, 1.0, 5.66), (1.0, 2.0, 4.15), (1.0, 3.0, 7.10),
            (2.0, 1.0, 14.95), (2.0, 2.0, 7.73), (2.0, 3.0, 2.10),
            (3.0, 1.0, 4.29), (3.0, 2.0, 1.65), (3.0, 3.0, 16.77)) as paper(times, masses, paper_gain))
select
    round(speed, 0) as "speed",
    round(mass, 0) as "hand's mass",
    round(pd, 1) as "PD, %",
    round(ahead, 1) as "with feedforward, %",
    round(ahead - pd, 1) as "gain",
    round(paper_gain, 2) as "paper's gain"
from sums join paper on sums.speed = paper.times and sums.mass = paper.masses
order by speed, mass
