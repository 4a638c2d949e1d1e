-- What the squeeze and the script around a motion add: share of the refined motions for the bundled objects that
-- succeeds, with the squeeze that is planned from the contacts, with the script's and with none, the fingers following
-- the motion or opened and closed by script.
--
-- pipeline run pipelines/studies/script.toml --profile table_lift
with
    planned as (
        select run as of_run, max(case when key = 'squeeze_m' then 1000 * number end) as squeeze_mm
        from settings where stage = 'refine' and run in (select run from runs) group by run)
select
    '`' || approach || '`' as "approach",
    round(squeeze_mm, 0) as "planned squeeze, mm",
    round(squeeze_rad, 2) as "scripted squeeze, rad",
    origin as "latent codes",
    draws_n as "samples",
    candidates_n as "candidates",
    round(100 * draw_rate, 1) as "succeed, by sample, %",
    round(100 * candidate_rate, 1) as "by candidate, %",
    round(100 * candidate_rate_mean, 1) as "objects' mean, %",
    round(100 * candidate_rate_low, 1) as "from, %",
    round(100 * candidate_rate_high, 1) as "to, %"
from all_rates join planned on all_rates.run = planned.of_run
where run in (select run from runs) and origin <> 'all'
order by approach, squeeze_mm desc, squeeze_rad desc, origin
