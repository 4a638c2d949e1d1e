-- Motions at the simulated cell with its sampled errors: the most robust ones, and the first accepted ones of the
-- same objects, five seeds of training and drawing. The difference is the mean over objects, each over all its seeds,
-- with Student's 95 % interval (19 degrees of freedom).
--
-- pipeline run pipelines/studies/robustness.toml --profile table_lift --set ingest.root=$DEXYCB --set seed=1,2,3,4,5
with
    by_object as (
        select object,
            100.0 * sum(case when stage = 'dispatch' and outcome = 'succeeded' then 1 else 0 end)
                / sum(case when stage = 'dispatch' then 1 else 0 end) as robust,
            100.0 * sum(case when stage <> 'dispatch' and outcome = 'succeeded' then 1 else 0 end)
                / sum(case when stage <> 'dispatch' then 1 else 0 end) as accepted,
            sum(case when stage = 'dispatch' then 1 else 0 end) as n,
            sum(case when stage <> 'dispatch' then 1 else 0 end) as others
        from all_executions where run in (select run from runs) and goal_id <> '' group by object),
    ends as (
        select count(*) as objects_n, sum(n) as n, sum(others) as others, avg(robust) as robust, avg(accepted) as accepted,
            avg(robust - accepted) as gain,
            case when count(*) = 20 then 2.093 * stddev(robust - accepted) / sqrt(20.0) end as reach,
            sum(case when robust > accepted then 1 else 0 end) as more,
            sum(case when robust < accepted then 1 else 0 end) as fewer
        from by_object)
select
    objects_n as "objects",
    n || ' and ' || others as "executions",
    round(robust, 1) as "most robust: succeed, %",
    round(accepted, 1) as "first accepted: succeed, %",
    round(gain, 1) as "difference",
    round(gain - reach, 1) as "from",
    round(gain + reach, 1) as "to",
    more as "objects with more",
    fewer as "objects with fewer"
from ends
