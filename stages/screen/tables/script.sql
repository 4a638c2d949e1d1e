-- What the script around a motion adds: share of the refined motions for the bundled objects that holds, the
-- fingers following the motion or opened and closed by script, with a squeeze and without.
--
-- pipeline run pipelines/script.toml
select
    '`' || approach || '`' as "approach",
    round(squeeze_rad, 2) as "squeeze, rad",
    origin as "latent codes",
    draws_n as "draws",
    candidates_n as "candidates",
    round(100 * draw_rate, 1) as "hold, by draw, %",
    round(100 * candidate_rate, 1) as "by candidate, %",
    round(100 * candidate_rate_mean, 1) as "objects' mean, %",
    round(100 * candidate_rate_low, 1) as "from, %",
    round(100 * candidate_rate_high, 1) as "to, %"
from all_rates where run in (select run from runs) and origin <> 'all'
order by approach, squeeze_rad desc, origin
