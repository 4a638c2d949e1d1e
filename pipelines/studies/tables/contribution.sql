-- Contribution of the learned function: motions of each generator, single ones and the best of four by residual, refined and
-- judged alike, every object as it was recorded: means over the objects of the share that succeeds, with Student's 95 %
-- interval, and the difference to the function on objects of the same kind, seen or unseen, paired by object. Four folds,
-- so that every object is unseen once; generators that learn nothing, and those that are far off, have one seed. An
-- object's own demonstrations each lie in a pose of their own, so that none of them compete.
--
-- pipeline run pipelines/studies/contribution.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/contribution_generators.toml --set ingest.root=$DEXYCB
with
    variants as (
        select run as of_run,
            max(case when stage = 'refine' and key = 'draws' then number end) as draws,
            max(case when stage = 'train' and key = 'training.epochs' then number else 0 end) as epochs,
            max(case when stage = 'sample' and key = 'shape' and value like '%other%' then 1 else 0 end) as is_other
        from settings where run in (select run from runs) group by run),
    generators as (
        select of_run, draws, runs.seed as seed,
            case when overrides like '%replay%' then 40 when overrides like '%nearest%' then 50
                when overrides like '%other.candidates%' then 60 when overrides like '%mean.%' then 70
                when overrides like '%random_palm%' then 80 when overrides like '%force_closure%' then 90
                when overrides like '%grasp_tta%' then 100 when is_other = 1 then 15 when epochs = 2 then 13
                when epochs = 10 then 12 else 10 end as place
        from variants join runs on of_run = run),
    counts as (
        select place, draws, seed, object, 1.0 * candidates_n as n, 1.0 * successes_n as s,
            case when place in (40, 70, 100) then 'seen' when place < 40 then object_split else 'unseen' end as split
        from all_success join generators on all_success.run = generators.of_run
        where draws = 1 or place not in (40, 70)),
    by_object as (
        select place, split, draws, object, sum(n) as n, 100 * sum(s) / sum(n) as share
        from counts group by place, split, draws, object),
    functions as (
        select split as f_split, draws as f_draws, object as f_object, share as f_share from by_object where place = 10),
    means as (
        select place, split, draws, count(share) as objects_n, sum(n) as n, avg(share) as share, min(share) as least,
            2.093 * stddev(share) / sqrt(20.0) as reach,
            avg(share - f_share) as gap, 2.093 * stddev(share - f_share) / sqrt(20.0) as gap_reach
        from by_object join functions on split = f_split and draws = f_draws and object = f_object
        group by place, split, draws),
    seeds as (
        select place as s_place, split as s_split, count(distinct seed) as seeds_n from counts group by place, split),
    names as (
        select * from (values
            (10, 'the function'), (12, 'the function after 10 epochs'), (13, 'the function after 2 epochs'),
            (15, 'the function, shown another object'), (40, 'the object''s own demonstrations'),
            (50, 'demonstrations of the most similar object'), (60, 'demonstrations of any other object'),
            (70, 'the mean of the object''s own demonstrations'), (80, 'random palms, fingers closed'),
            (90, 'fingertip grasps by force closure'), (100, 'grasps of `grasp_tta`')) as names(number, shown))
select
    shown as "motions",
    split as "object",
    seeds_n as "seeds",
    case when draws > 1 then 'best of four' else 'single' end as "chosen",
    round(n, 0) as "candidates",
    round(share, 1) as "succeed, %",
    round(share - reach, 0) as "from",
    round(share + reach, 0) as "to",
    round(least, 0) as "least object",
    case when place > 10 then round(gap, 1) end as "difference",
    case when place > 10 then round(gap - gap_reach, 0) end as "at least",
    case when place > 10 then round(gap + gap_reach, 0) end as "at most"
from means join names on means.place = names.number
    join seeds on means.place = seeds.s_place and means.split = seeds.s_split
order by draws, means.place, split
