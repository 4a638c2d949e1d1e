-- Refined motions of the prior that succeed, single samples and the best of four by residual, palm and fingers following
-- the motion: means over the objects of the share of motions, with Student's 95 % interval over the 20 objects, each
-- over all its folds and five seeds; and how far the means of single seeds spread.
--
-- pipeline run pipelines/studies/refinement.toml --profile table_lift --set ingest.root=$DEXYCB
with
    options as (
        select run as of_run, max(number) as draws
        from settings where stage = 'refine' and key = 'draws' and run in (select run from runs) group by run),
    counts as (
        select draws, seed, object_split, object, 1.0 * draws_n as d, 1.0 * candidates_n as n, 1.0 * successes_n as s
        from all_success join options on all_success.run = options.of_run join runs on all_success.run = runs.run),
    by_object as (
        select draws, object_split, object, sum(d) as d, sum(n) as n, 100 * sum(s) / sum(n) as share
        from counts group by draws, object_split, object),
    by_seed as (
        select draws, object_split, seed, object, 100 * sum(s) / sum(n) as share
        from counts group by draws, object_split, seed, object),
    of_seeds as (
        select draws, object_split, seed, avg(share) as share from by_seed group by draws, object_split, seed),
    seeds as (
        select draws as of_draws, object_split as of_split, stddev(share) as spread
        from of_seeds group by draws, object_split),
    means as (
        select draws, object_split, count(share) as objects_n, sum(d) as d, sum(n) as n, avg(share) as share,
            min(share) as least, case when count(share) = 20 then 2.093 * stddev(share) / sqrt(20.0) end as reach
        from by_object group by draws, object_split)
select
    case when draws > 1 then 'best of four' else 'single samples' end as "refined motions",
    objects_n || ' ' || object_split as "objects",
    round(d, 0) as "samples",
    round(n, 0) as "candidates",
    round(share, 1) as "succeed, %",
    round(share - reach, 1) as "from",
    round(share + reach, 1) as "to",
    round(spread, 1) as "seeds' deviation",
    round(least, 0) as "least object"
from means join seeds on draws = of_draws and object_split = of_split
order by draws, object_split
