-- Refined motions for each object, each the best of four draws, by three functions that have seen it and by one that
-- has not, the number of all of them that fails by each reason, and the share of the object's demonstrations that hold.
--
-- pipeline run pipelines/replay.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set sample.per_object=500
with
    sampled as (
        select object as sampled_object,
            100.0 * sum(case when object_split = 'seen' then successes_n else 0 end)
                / sum(case when object_split = 'seen' then candidates_n else 0 end) as seen,
            100.0 * sum(case when object_split = 'unseen' then successes_n else 0 end)
                / sum(case when object_split = 'unseen' then candidates_n else 0 end) as unseen,
            100.0 * sum(case when object_split = 'unseen' then successes_n else 0 end)
                / sum(case when object_split = 'unseen' then draws_n else 0 end) as unseen_draws,
            sum(not_grasped_n) as not_grasped, sum(table_n) as at_table, sum(early_contact_n) as early,
            sum(knocked_over_n) as knocked, sum(dropped_n) + sum(slipped_n) as lost, sum(too_deep_n) as deep,
            sum(limit_n) + sum(diverged_n) + sum(infeasible_n) as other
        from all_success where pipeline = 'unseen' and run in (select run from runs) group by object),
    replayed as (
        select object as demonstrated, rate as demonstrated_rate from all_success
        where pipeline = 'replay' and run in (select run from runs))
select
    replace(substr(sampled_object, 5), '_', ' ') as "object",
    round(seen, 0) as "seen: hold, %",
    round(unseen, 0) as "unseen: hold, %",
    round(unseen_draws, 0) as "unseen, by draw, %",
    not_grasped as "not grasped",
    at_table as "table",
    early as "early contact",
    knocked as "knocked over",
    lost as "dropped, slipped",
    deep as "too deep",
    other as "limit, diverged, infeasible",
    round(100 * demonstrated_rate, 0) as "demonstrations hold, %"
from sampled left join replayed on sampled.sampled_object = replayed.demonstrated
order by sampled_object
