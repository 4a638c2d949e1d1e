-- How well the screen and MuJoCo agree on motions of the function of this repository, refined single samples, accepted or
-- not, 40 for each object of DexYCB, with the object's convex parts shared and with own ones; and the greatest difference
-- of the two rates of one object.
--
-- pipeline run pipelines/studies/agreement_pretrained.toml --set seed=1 --set ingest.root=$DEXYCB
with
    variants as (
        select run as variant, max(case when value like '%own%' then 'own' else 'shared' end) as parts
        from settings where stage = 'mujoco' and key = 'options.parts' and run in (select run from runs) group by run),
    apart as (
        select run as apart_run, max(100.0 * abs(first_rate - second_rate)) as most
        from all_agreement where of = 'object' group by run)
select
    name as "objects",
    parts as "parts of MuJoCo",
    candidates_n as "motions",
    round(100.0 * first_rate, 1) as "succeed here, %",
    round(100.0 * second_rate, 1) as "in MuJoCo, %",
    both_n as "in both",
    only_first_n as "here alone",
    only_second_n as "there alone",
    round(100.0 * agreement, 1) as "equal verdicts, %",
    round(kappa, 2) as "kappa",
    case when name = 'all' then round(most, 1) end as "most of an object, points"
from all_agreement join variants on all_agreement.run = variants.variant join apart on all_agreement.run = apart_run
where of <> 'object'
order by parts desc, name
