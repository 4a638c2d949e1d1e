-- What each part of the refinement changes: single samples of the prior that succeed, palm and fingers following the
-- motion: means over the objects of the share of motions, with Student's 95 % interval over 20 seen and 15 unseen
-- objects, and why unseen objects' motions fail. Three folds of four; the defaults were chosen on the other.
--
-- pipeline run pipelines/studies/refinement_parts.toml --set ingest.root=$DEXYCB
with
    options as (
        select run as of_run,
            max(case when stage = 'refine' and key = 'squeeze_m' then number end) as planned,
            max(case when stage = 'screen' and key = 'protocol.squeeze_rad' then number end) as scripted,
            max(case when stage = 'refine' and key = 'restart_angle_rad' then number end) as restarts,
            max(case when stage = 'refine' and key = 'balance_weight' then number end) as balance,
            max(case when stage = 'refine' and key = 'contact_weight' then number end) as contact,
            max(case when stage = 'refine' and key = 'clearance_m' then number end) as clearance,
            max(case when stage = 'refine' and key = 'object_weight' then number end) as keep_out,
            max(case when stage = 'refine' and key = 'table_weight' then number end) as off_table,
            max(case when stage = 'refine' and key = 'self_collision_weight' then number end) as apart
        from settings where run in (select run from runs) group by run),
    kinds as (
        select of_run, case when scripted > 0 then 4 when planned = 0 then 3 when restarts = 0 then 5
            when contact = 0 then 7 when balance = 0 then 6 when keep_out = 0 then 9 when clearance = 0 then 8
            when off_table = 0 then 10 when apart = 0 then 11 else 2 end as place from options),
    counts as (
        select case when stage = 'screen_drawn' then 1 else place end as place, object_split, object,
            1.0 * candidates_n as n, 1.0 * successes_n as s, 1.0 * table_n as tab, 1.0 * early_contact_n as early,
            1.0 * knocked_over_n as knocked, 1.0 * not_grasped_n as grasped,
            1.0 * (slipped_n + dropped_n) as dropped, 1.0 * too_deep_n as deep, 1.0 * overloaded_n as loaded
        from all_success join kinds on all_success.run = kinds.of_run
        where stage <> 'screen_drawn' or place = 2),
    by_object as (
        select place, object_split, object, 100 * sum(s) / sum(n) as share, 100 * sum(tab) / sum(n) as tab,
            100 * sum(early) / sum(n) as early, 100 * sum(knocked) / sum(n) as knocked,
            100 * sum(grasped) / sum(n) as grasped, 100 * sum(dropped) / sum(n) as dropped,
            100 * sum(deep) / sum(n) as deep, 100 * sum(loaded) / sum(n) as loaded
        from counts group by place, object_split, object),
    means as (
        select place, object_split, avg(share) as middle, min(share) as least,
            case when count(*) = 20 then 2.093 when count(*) = 15 then 2.145 end
                * stddev(share) / sqrt(1.0 * count(*)) as reach,
            avg(tab) as tab, avg(early) as early, avg(knocked) as knocked, avg(grasped) as grasped,
            avg(dropped) as dropped,
            avg(deep) as deep, avg(loaded) as loaded
        from by_object group by place, object_split),
    seen as (select place, middle, reach, least from means where object_split = 'seen'),
    unseen as (select * from means where object_split = 'unseen'),
    names as (
        select * from (values
            (1, 'as sampled, with the scripted squeeze'), (2, 'refined'), (3, 'without `squeeze_m`'),
            (4, 'without `squeeze_m`, with the scripted squeeze'), (5, 'without `restart_angle_rad`'),
            (6, 'without `balance_weight`'), (7, 'without `contact_weight` too, and so without the squeeze'),
            (8, 'without `clearance_m`'),
            (9, 'without `object_weight` too'), (10, 'without `table_weight`'), (11, 'without `self_collision_weight`'))
            as names(number, shown))
select
    shown as "samples",
    round(seen.middle, 1) as "seen: succeed, %",
    round(seen.middle - seen.reach, 0) as "from",
    round(seen.middle + seen.reach, 0) as "to",
    round(seen.least, 0) as "least object",
    round(unseen.middle, 1) as "unseen: succeed, %",
    round(unseen.middle - unseen.reach, 0) as "unseen: from",
    round(unseen.middle + unseen.reach, 0) as "unseen: to",
    round(unseen.least, 0) as "unseen: least object",
    round(tab, 0) as "table",
    round(early, 0) as "early contact",
    round(knocked, 0) as "knocked over",
    round(grasped, 0) as "not grasped",
    round(dropped, 0) as "slipped, dropped",
    round(deep, 0) as "too deep",
    round(loaded, 0) as "overloaded"
from seen join unseen on seen.place = unseen.place join names on seen.place = names.number
order by number
