-- Contribution of the learned function: motions of each generator, one sample each, refined alike, palm and fingers following the
-- motion to its planned squeeze: means over the objects of the share that succeeds, with Student's 95 % interval, and the least
-- and the greatest seed. Four folds, so that every object is unseen once; generators that learn nothing have one seed.
--
-- pipeline run pipelines/studies/contribution.toml --profile table_lift --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/contribution_generators.toml --profile table_lift --set ingest.root=$DEXYCB
with
    generators as (
        select run as of_run,
            case when overrides like '%shuffled%' then 30 when overrides like '%replay%' then 40
                when overrides like '%nearest%' then 50 when overrides like '%other.%' then 60
                when overrides like '%mean.%' then 70 when overrides like '%random_palm%' then 80
                when overrides like '%force_closure%' then 90 else 10 end as place,
            case when overrides like '%seed=2%' then 2 when overrides like '%seed=3%' then 3
                when overrides like '%seed=4%' then 4 when overrides like '%seed=5%' then 5 else 1 end as seed
        from runs where run in (select run from runs)),
    counts as (
        select case when place = 10 and origin = 'posterior' then 20 else place end as place,
            case when place < 40 then object_split else '' end as split, object, seed,
            1.0 * candidates_n as n, 1.0 * successes_n as s
        from all_success join generators on all_success.run = generators.of_run),
    by_object as (
        select place, split, object, sum(n) as n, 100 * sum(s) / sum(n) as share
        from counts group by place, split, object),
    seeds_by_object as (
        select place, split, seed, object, 100 * sum(s) / sum(n) as share from counts group by place, split, seed, object),
    seeds as (select place, split, seed, avg(share) as share from seeds_by_object group by place, split, seed),
    extremes as (
        select place as seed_place, split as seed_split, count(share) as seeds_n, min(share) as low, max(share) as high
        from seeds group by place, split),
    means as (
        select place, split, count(share) as objects_n, sum(n) as n, avg(share) as share, min(share) as least,
            2.093 * stddev(share) / sqrt(20.0) as reach
        from by_object group by place, split),
    names as (
        select * from (values
            (10, 'the function, codes of the prior'), (20, 'the function, codes of demonstrations'),
            (30, 'the function, shown another object'), (40, 'the object''s own demonstrations'),
            (50, 'demonstrations of the most similar object'), (60, 'demonstrations of any other object'),
            (70, 'the mean of the object''s own demonstrations'),
            (80, 'random palms, fingers closed'), (90, 'fingertip grasps by force closure')) as names(number, shown))
select
    shown as "motions",
    split as "object in training",
    objects_n as "objects",
    seeds_n as "seeds",
    round(n, 0) as "motions tried",
    round(share, 1) as "succeed, %",
    round(share - reach, 0) as "from",
    round(share + reach, 0) as "to",
    round(low, 1) as "least seed",
    round(high, 1) as "greatest seed",
    round(least, 0) as "least object"
from means join names on means.place = names.number
    join extremes on means.place = extremes.seed_place and means.split = extremes.seed_split
order by means.place, split
