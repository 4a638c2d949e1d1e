-- The objects on which the screen and MuJoCo differ, the most first; friction 1, contacts about as soft.
--
-- pipeline run pipelines/studies/agreement.toml --set seed=1 --set ingest.root=/path/to/dexycb-right
with
    first_variant as (select min(run) as variant from settings where run in (select run from runs))
select
    name as "object",
    candidates_n as "motions",
    first_n as "succeed here",
    second_n as "in MuJoCo",
    only_first_n as "here alone",
    only_second_n as "there alone",
    lost_dropped_n as "fall there",
    lost_slipped_n as "slip there",
    lost_not_grasped_n as "not lifted there",
    round(kappa, 2) as "kappa"
from all_agreement join first_variant on all_agreement.run = first_variant.variant
where of = 'object' and differ_n > 1
order by differ_n desc, name
