-- Motions sampled for the bundled objects, and the straight line between the ends of each, the hand following
-- the whole motion. The 95 % interval is Wilson's.
--
-- pipeline run pipelines/baseline.toml
with
    sums as (
        select generator, 1.0 * sum(candidates_n) as n, 1.0 * sum(successes_n) as held,
            sum(knocked_over_n) as knocked_over, sum(table_n) as in_table, sum(not_grasped_n) as not_grasped,
            sum(dropped_n) + sum(slipped_n) as dropped, sum(early_contact_n) as early,
            sum(control_steps_n) as steps
        from all_success where run in (select run from runs) group by generator),
    shares as (
        select *, held / n as p, (held / n + 1.920729 / n) / (1 + 3.841459 / n) as middle,
            1.959964 * sqrt(held / n * (1 - held / n) / n + 0.960365 / n / n) / (1 + 3.841459 / n) as reach
        from sums)
select
    '`' || generator || '`' as "generator",
    round(n, 0) as "motions",
    round(100 * p, 1) as "hold, %",
    round(100 * (middle - reach), 1) as "from, %",
    round(100 * (middle + reach), 1) as "to, %",
    knocked_over as "knocked over",
    in_table as "below the table",
    not_grasped as "not grasped",
    dropped as "dropped or slipped",
    early as "inside the object",
    round(steps / held, 0) as "control steps per success"
from shares order by "generator"
