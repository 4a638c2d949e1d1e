-- As `agreement.sql`, with convex parts that the judge in MuJoCo has of its own.
--
-- pipeline run pipelines/studies/agreement_parts.toml --set seed=1 --set ingest.root=/path/to/dexycb-right
with
    variants as (
        select run as variant,
            max(case when stage = 'screen' and key = 'scene.friction' then number end) as friction,
            max(case when stage = 'mujoco' and key = 'options.engine.cone' then value end) as cone,
            max(case when stage = 'mujoco' and key = 'options.engine.solref' then value end) as solref,
            max(case when stage = 'mujoco' and key = 'options.parts' then value end) as parts
        from settings where run in (select run from runs) group by run),
    named as (
        select variant, friction, case
            when cone like '%pyramidal%' then 'its defaults'
            when solref like '%0.005%' then 'twice as stiff'
            else 'as the screen''s' end as contacts
        from variants where parts like '%own%')
select
    friction as "friction",
    contacts as "contacts of MuJoCo",
    name as "objects",
    candidates_n as "motions",
    round(100.0 * first_rate, 1) as "succeed here, %",
    round(100.0 * second_rate, 1) as "in MuJoCo, %",
    both_n as "in both",
    only_first_n as "here alone",
    only_second_n as "there alone",
    round(100.0 * agreement, 1) as "equal verdicts, %",
    round(kappa, 2) as "kappa",
    round(100.0 * accepted_hold, 1) as "of those that succeed here, %"
from all_agreement join named on all_agreement.run = named.variant
where of <> 'object'
order by friction desc, contacts, name
