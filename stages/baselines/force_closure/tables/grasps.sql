-- Grasps of four objects by optimization of the min-weight metric and by annealing in a space of eigengrasps, each at
-- its published budget, and random palms whose fingers close: by the same approach, script and screen.
--
-- pipeline run pipelines/grasps.toml --profile table_lift --set ingest.root=$DEXYCB
with
    sums as (
        select generator as screened, sum(not_grasped_n) as not_grasped, sum(table_n) as in_table,
            sum(knocked_over_n) as knocked_over, sum(dropped_n) + sum(slipped_n) as dropped,
            sum(early_contact_n) + sum(too_deep_n) as inside, sum(control_steps_n) as steps
        from all_success where run in (select run from runs) group by generator)
select
    '`' || generator || '`' as "generator",
    objects_n as "objects",
    candidates_n as "candidates",
    round(100 * candidate_rate, 1) as "succeed, %",
    round(100 * candidate_rate_mean, 1) as "objects' mean, %",
    round(100 * candidate_rate_low, 1) as "from, %",
    round(100 * candidate_rate_high, 1) as "to, %",
    not_grasped as "not grasped",
    in_table as "below the table",
    knocked_over as "knocked over",
    dropped as "dropped or slipped",
    inside as "inside the object",
    round(1.0 * steps / successes_n, 0) as "control steps per success"
from all_rates join sums on all_rates.generator = sums.screened
where origin = 'all' and run in (select run from runs)
order by candidate_rate desc
