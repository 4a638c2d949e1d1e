-- Refined motions of the prior for each object, single samples and the best of four, by functions that have seen it and
-- that have not (five seeds, four folds), the share of the unseen single samples that fails by each reason, and the share
-- of the object's demonstrations that succeed.
--
-- pipeline run pipelines/replay.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/refinement.toml --set ingest.root=$DEXYCB
with
    options as (
        select run as of_run, max(case when stage = 'refine' and key = 'draws' then number end) as best_of,
            max(case when stage = 'screen' and key = 'pose_error.position_m' then number end) as error_m
        from settings where run in (select run from runs) group by run),
    sampled as (
        select object, object_split, best_of, sum(1.0 * candidates_n) as n, sum(1.0 * successes_n) as s,
            sum(1.0 * not_grasped_n) as not_grasped, sum(1.0 * table_n) as at_table,
            sum(1.0 * early_contact_n) as early, sum(1.0 * knocked_over_n) as knocked,
            sum(1.0 * overloaded_n) as overloaded,
            sum(1.0 * dropped_n) + sum(1.0 * slipped_n) as lost, sum(1.0 * too_deep_n) as deep,
            sum(1.0 * limit_n) + sum(1.0 * diverged_n) + sum(1.0 * infeasible_n) as other
        from all_success join options on all_success.run = options.of_run where error_m = 0
        group by object, object_split, best_of),
    unseen as (select * from sampled where object_split = 'unseen' and best_of = 1),
    seen as (
        select object as seen_object, 100 * s / n as seen_share from sampled
        where object_split = 'seen' and best_of = 1),
    seen_best as (
        select object as seen_best_object, 100 * s / n as seen_best_share from sampled
        where object_split = 'seen' and best_of > 1),
    unseen_best as (
        select object as unseen_best_object, 100 * s / n as unseen_best_share from sampled
        where object_split = 'unseen' and best_of > 1),
    replayed as (
        select object as demonstrated, rate as demonstrated_rate from all_success
        where pipeline = 'replay' and run in (select run from runs))
select
    replace(substr(object, 5), '_', ' ') as "object",
    round(seen_share, 0) as "seen, single: succeed, %",
    round(seen_best_share, 0) as "seen, best of four, %",
    round(100 * s / n, 0) as "unseen, single, %",
    round(unseen_best_share, 0) as "unseen, best of four, %",
    round(100 * not_grasped / n, 0) as "not grasped",
    round(100 * at_table / n, 0) as "table",
    round(100 * early / n, 0) as "early contact",
    round(100 * knocked / n, 0) as "knocked over",
    round(100 * overloaded / n, 0) as "overloaded",
    round(100 * lost / n, 0) as "dropped, slipped",
    round(100 * deep / n, 0) as "too deep",
    round(100 * other / n, 0) as "limit, diverged, infeasible",
    round(100 * demonstrated_rate, 0) as "demonstrations succeed, %"
from unseen join seen on object = seen_object join seen_best on object = seen_best_object
    join unseen_best on object = unseen_best_object left join replayed on object = demonstrated
order by object
