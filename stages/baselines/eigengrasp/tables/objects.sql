-- Grasps by annealing in a space of eigengrasps at the published budget, by object, beside random palms whose fingers
-- close.
--
-- pipeline run pipelines/grasps.toml --profile table_lift --set ingest.root=$DEXYCB
with
    sums as (
        select object as grasped,
            sum(case when generator = 'eigengrasp' then candidates_n else 0 end) as annealed_n,
            sum(case when generator = 'eigengrasp' then successes_n else 0 end) as annealed,
            sum(case when generator = 'eigengrasp' then not_grasped_n else 0 end) as not_grasped,
            sum(case when generator = 'eigengrasp' then table_n else 0 end) as in_table,
            sum(case when generator = 'eigengrasp' then knocked_over_n else 0 end) as knocked_over,
            sum(case when generator = 'random_palm' then candidates_n else 0 end) as random_n,
            sum(case when generator = 'random_palm' then successes_n else 0 end) as random_held
        from all_success where run in (select run from runs) group by object)
select
    grasped as "object",
    annealed_n as "grasps",
    round(100.0 * annealed / annealed_n, 0) as "succeed, %",
    not_grasped as "not grasped",
    in_table as "below the table",
    knocked_over as "knocked over",
    round(100.0 * random_held / random_n, 0) as "random palms succeed, %"
from sums order by "object"
