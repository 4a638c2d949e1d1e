-- Refined motions of the prior that succeed, single samples, also with an error of the object's estimated pose, and the
-- best of four by residual, of two hands, palm and fingers following the motion: means over the objects of the share of
-- motions, with Student's 95 % interval over the 20 objects, each over all its folds and seeds; the mean over the objects
-- that are unseen (or seen) by the functions of folds 2 to 4; and how far the means of single seeds spread.
--
-- pipeline run pipelines/studies/refinement.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/refinement.toml --set ingest.root=$DEXYCB --set shared.hand=data/hands/leap_right.toml --set seed=1
with
    options as (
        select run as of_run,
            max(case when stage = 'refine' and key = 'draws' then number end) as draws,
            max(case when stage = 'screen' and key = 'pose_error.position_m' then number end) as error_m,
            max(case when stage = 'train' and key = 'unseen_fold' and value like '%1/4%' then 1 else 0 end) as is_first
        from settings where run in (select run from runs) group by run),
    counts as (
        select case when overrides like '%leap_right.toml%' then 1 else 0 end as is_leap, draws, error_m, is_first, seed,
            object_split, object, 1.0 * draws_n as d, 1.0 * candidates_n as n, 1.0 * successes_n as s
        from all_success join options on all_success.run = options.of_run join runs on all_success.run = runs.run),
    by_object as (
        select is_leap, draws, error_m, object_split, object, sum(d) as d, sum(n) as n,
            100 * sum(s) / sum(n) as share,
            100 * sum(case when is_first = 0 then s end) / sum(case when is_first = 0 then n end) as share_of_others
        from counts group by is_leap, draws, error_m, object_split, object),
    by_seed as (
        select is_leap, draws, error_m, object_split, seed, object, 100 * sum(s) / sum(n) as share
        from counts group by is_leap, draws, error_m, object_split, seed, object),
    of_seeds as (
        select is_leap, draws, error_m, object_split, seed, avg(share) as share
        from by_seed group by is_leap, draws, error_m, object_split, seed),
    seeds as (
        select is_leap as of_leap, draws as of_draws, error_m as of_error_m, object_split as of_split,
            case when count(share) > 1 then stddev(share) end as spread, count(share) as seeds_n
        from of_seeds group by is_leap, draws, error_m, object_split),
    means as (
        select is_leap, draws, error_m, object_split, count(share) as objects_n, sum(d) as d, sum(n) as n,
            avg(share) as share, avg(share_of_others) as share_of_others, min(share) as least,
            case when count(share) = 20 then 2.093 * stddev(share) / sqrt(20.0) end as reach
        from by_object group by is_leap, draws, error_m, object_split)
select
    case when is_leap = 1 then 'LEAP' else 'Allegro' end as "hand",
    case when draws > 1 then 'best of four'
        when error_m > 0 then 'single samples, object 5 mm and 5° off' else 'single samples' end as "refined motions",
    objects_n || ' ' || object_split as "objects",
    seeds_n as "seeds",
    round(d, 0) as "samples",
    round(n, 0) as "candidates",
    round(share, 1) as "succeed, %",
    round(share - reach, 1) as "from",
    round(share + reach, 1) as "to",
    round(share_of_others, 1) as "folds 2 to 4, %",
    round(spread, 1) as "seeds' deviation",
    round(least, 0) as "least object"
from means join seeds on is_leap = of_leap and draws = of_draws and error_m = of_error_m and object_split = of_split
order by is_leap, draws, error_m, object_split
