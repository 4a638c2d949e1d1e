-- How well the screen and MuJoCo agree where fingers touch each other and the palm, and where the palm yields, with the
-- object's convex parts shared and with own ones; single samples of the prior on the bundled sample, 20 for each object, and the
-- first 10 of them where the palm yields.
--
-- pipeline run pipelines/studies/agreement_hand.toml --set seed=1
-- pipeline run pipelines/studies/agreement_hand.toml --set seed=1 --set sample.per_object=10 --set screen.scene.palm_compliance.force_limit_n=50 --set mujoco.options.scene.palm_compliance.force_limit_n=50
with
    variants as (
        select run as variant,
            max(case when stage = 'mujoco' and key = 'options.scene.fingers_touch' then value end) as touch,
            max(case when stage = 'mujoco' and key = 'options.scene.palm_compliance.force_limit_n' then number end) as force_n,
            max(case when stage = 'mujoco' and key = 'options.parts' then value end) as parts
        from settings where run in (select run from runs) group by run)
select
    case when touch = 'true' then 'touch' else 'pass through' end as "fingers",
    case when force_n is null then 'fixed' else 'yields' end as "palm",
    case when parts like '%own%' then 'own' else 'shared' end as "parts of MuJoCo",
    candidates_n as "motions",
    round(100.0 * first_rate, 1) as "succeed here, %",
    round(100.0 * second_rate, 1) as "in MuJoCo, %",
    both_n as "in both",
    only_first_n as "here alone",
    only_second_n as "there alone",
    round(100.0 * agreement, 1) as "equal verdicts, %",
    round(kappa, 2) as "kappa"
from all_agreement join variants on all_agreement.run = variants.variant
where of = 'all'
order by "palm", "fingers", "parts of MuJoCo" desc
