-- Motions sampled for each object by a model that has seen 15 of the 20, the number that fails by each
-- reason, and beside them the share of the object's demonstrations that hold.
--
-- pipeline run pipelines/replay.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set sample.per_object=500
with
    sampled as (
        select object as sampled_object, max(object_split) as split, 100.0 * sum(successes_n) / sum(candidates_n) as held,
            100.0 * sum(successes_n) / sum(draws_n) as held_of_draws, sum(not_grasped_n) as not_grasped,
            sum(table_n) as in_table, sum(early_contact_n) as early, sum(knocked_over_n) as knocked_over,
            sum(dropped_n) + sum(slipped_n) as dropped, sum(too_deep_n) as too_deep,
            sum(limit_n) + sum(diverged_n) + sum(infeasible_n) as others
        from all_success where pipeline = 'unseen' and run in (select run from runs) group by object),
    replayed as (
        select object as demonstrated, rate as demonstrated_rate from all_success
        where pipeline = 'replay' and run in (select run from runs))
select
    replace(substr(sampled_object, 5), '_', ' ') || case when split = 'unseen' then ' (unseen)' else '' end as "object",
    round(held, 0) as "hold, %",
    round(held_of_draws, 0) as "of draws, %",
    not_grasped as "not grasped",
    in_table as "table",
    early as "early contact",
    knocked_over as "knocked over",
    dropped as "dropped, slipped",
    too_deep as "too deep",
    others as "limit, diverged, infeasible",
    round(100 * demonstrated_rate, 0) as "demonstrations hold, %"
from sampled left join replayed on sampled.sampled_object = replayed.demonstrated
order by sampled_object
