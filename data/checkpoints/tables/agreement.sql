-- How well the screen and MuJoCo agree on the default physics, with the object's convex parts shared and with own ones:
-- refined single samples of the function of this repository, accepted or not, 40 for each object; and the object
-- whose rates differ most.
--
-- pipeline run pipelines/studies/agreement_pretrained.toml --set seed=1 --set ingest.root=$DEXYCB
with
    variants as (
        select run as variant,
            max(case when stage = 'mujoco' and key = 'options.parts' and value like '%own%' then 1 else 0 end) as own
        from settings where run in (select run from runs) group by run),
    pooled as (
        select own, all_agreement.of as of, name, 1.0 * sum(candidates_n) as n, 1.0 * sum(first_n) as first_n,
            1.0 * sum(second_n) as second_n, 1.0 * sum(both_n) as both_n
        from all_agreement join variants on all_agreement.run = variants.variant
        group by own, all_agreement.of, name),
    shares as (
        select own, name, n, first_n, second_n, both_n, (n - first_n - second_n + 2.0 * both_n) / n as equal,
            (first_n * second_n + (n - first_n) * (n - second_n)) / (n * n) as by_chance
        from pooled where of <> 'object'),
    apart as (
        select own as apart_own, max(100.0 * abs(first_n - second_n) / n) as most
        from pooled where of = 'object' group by own)
select
    name as "objects",
    case when own = 1 then 'own' else 'shared' end as "parts of MuJoCo",
    round(n, 0) as "motions",
    round(100 * first_n / n, 1) as "succeed here, %",
    round(100 * second_n / n, 1) as "in MuJoCo, %",
    round(both_n, 0) as "in both",
    round(first_n - both_n, 0) as "here alone",
    round(second_n - both_n, 0) as "there alone",
    round(100 * equal, 1) as "equal verdicts, %",
    round((equal - by_chance) / (1 - by_chance), 2) as "kappa",
    case when name = 'all' then round(most, 1) end as "most of an object, points"
from shares join apart on own = apart_own
order by own, name
