-- Demonstrations carried out unchanged, and motions sampled by a model that has seen 15 of the 20 objects.
-- The 95 % interval is Wilson's. The paper's share is derived: 65 control steps of a trial over its cost
-- (Ye et al., RA-L 2023, table V).
--
-- pipeline run pipelines/replay.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/unseen.toml --set ingest.root=$DEXYCB --set sample.per_object=500
with
    unseen as (
        select distinct object as name from all_reconstruction
        where split = 'unseen' and run in (select run from runs)),
    sums as (
        select pipeline, case when name is null then 'seen' else 'unseen' end as objects, count(*) as objects_n,
            1.0 * sum(candidates_n) as n, 1.0 * sum(successes_n) as held
        from all_success left join unseen on all_success.object = unseen.name
        where run in (select run from runs)
        group by pipeline, objects),
    shares as (
        select *, held / n as p, (held / n + 1.920729 / n) / (1 + 3.841459 / n) as middle,
            1.959964 * sqrt(held / n * (1 - held / n) / n + 0.960365 / n / n) / (1 + 3.841459 / n) as reach
        from sums),
    paper as (
        select * from (values ('seen', '0.33'), ('unseen', '0.42')) as paper(split, share))
select
    case when pipeline = 'replay' then 'demonstrations' else 'sampled' end as "motions",
    objects_n || ' ' || objects as "objects",
    round(n, 0) as "number",
    round(100 * p, 1) as "hold, %",
    round(100 * (middle - reach), 1) as "from, %",
    round(100 * (middle + reach), 1) as "to, %",
    case when pipeline = 'replay' then null else share end as "the paper's, derived, %"
from shares join paper on shares.objects = paper.split
order by "motions", objects
