-- Refined motions for the bundled objects, and the straight line between the ends of each, the hand following
-- the whole motion. The 95 % interval is that of the objects' mean, by resampling objects.
--
-- pipeline run pipelines/baseline.toml --profile table_lift
with
    shares as (
        select * from all_rates where origin = 'all' and run in (select run from runs)),
    sums as (
        select generator as screened, sum(knocked_over_n) as knocked_over, sum(table_n) as in_table,
            sum(not_grasped_n) as not_grasped, sum(dropped_n) + sum(slipped_n) as dropped,
            sum(too_deep_n) as too_deep, sum(early_contact_n) as early, sum(control_steps_n) as steps
        from all_success where run in (select run from runs) group by generator)
select
    '`' || generator || '`' as "generator",
    objects_n as "objects",
    draws_n as "samples",
    candidates_n as "candidates",
    round(100 * candidate_rate, 1) as "succeed by candidate, %",
    round(100 * draw_rate, 1) as "by sample, %",
    round(100 * candidate_rate_mean, 1) as "objects' mean, %",
    round(100 * candidate_rate_low, 1) as "from, %",
    round(100 * candidate_rate_high, 1) as "to, %",
    knocked_over as "knocked over",
    in_table as "below the table",
    not_grasped as "not grasped",
    dropped as "dropped or slipped",
    too_deep as "too deep",
    early as "inside the object",
    round(1.0 * steps / successes_n, 0) as "control steps per success"
from shares join sums on shares.generator = sums.screened
order by "generator"
