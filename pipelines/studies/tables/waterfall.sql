-- Where the yield comes from: motions that succeed, one factor more in each arm from the authors' released code to the default, as
-- means over the objects of the share of all five seeds, with Student's 95 % interval over the objects, and the least and the
-- greatest seed.
--
-- pipeline run pipelines/studies/waterfall.toml --profile table_lift
with
    arms as (
        select run as of_run, case
            when overrides like '%"sample.candidates%' then 1 when overrides like '%sample_training%' then 2
            when overrides like '%sample_frame%' then 3 when overrides like '%squeeze_rad=0.15%' then 5
            when overrides like '%"sample_default.candidates%' then 4
            when overrides like '%draws=1"%' then 6 when overrides like '%demonstrated_share=0.5%' then 8 else 7 end as arm
        from runs where run in (select run from runs)),
    seeds as (
        select arm, run, object_split as split, 100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join arms on all_success.run = arms.of_run group by arm, run, object_split),
    extremes as (select arm as seed_arm, split as seed_split, count(share) as seeds_n, min(share) as least, max(share) as most
        from seeds group by arm, split),
    by_object as (
        select arm, object_split as split, object, 1.0 * sum(candidates_n) as n, 1.0 * sum(successes_n) as held
        from all_success join arms on all_success.run = arms.of_run group by arm, object_split, object),
    means as (
        select arm, split, sum(n) as n, sum(held) as held, count(n) as objects_n, 100 * avg(held / n) as share,
            case count(n) when 5 then 2.776 else 2.262 end * 100 * stddev(held / n) / sqrt(1.0 * count(n)) as reach
        from by_object group by arm, split),
    names as (
        select * from (values
            (1, 'the released code, a tenth of its epochs'), (2, 'and this network, its losses and training'),
            (3, 'and the frame of the resting object'), (4, 'and this retargeting'), (5, 'and a scripted squeeze'),
            (6, 'refinement, which plans a squeeze, in its place'), (7, 'and the best of four samples'),
            (8, 'and half the codes of demonstrations')) as names(number, shown))
select
    shown as "motions",
    split as "objects",
    seeds_n as "seeds",
    round(n, 0) as "motions tried",
    round(held, 0) as "succeed",
    round(share, 1) as "succeed, %",
    round(case when share - reach < 0 then 0 else share - reach end, 0) as "from",
    round(case when share + reach > 100 then 100 else share + reach end, 0) as "to",
    round(least, 1) as "least seed",
    round(most, 1) as "greatest seed"
from means join names on means.arm = names.number
    join extremes on means.arm = extremes.seed_arm and means.split = extremes.seed_split
order by means.arm, split
