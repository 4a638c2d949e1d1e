-- What each part of the training changes: fingertip errors, and single samples of the prior that succeed, as sampled with the
-- scripted squeeze and refined: means over the objects of the share of motions; the difference is to the default, paired by
-- object, with Student's 95 % interval over 20 seen and 15 unseen objects. Three folds of four; the defaults were chosen
-- on the other.
--
-- pipeline run pipelines/studies/training_parts.toml --profile table_lift --set ingest.root=$DEXYCB
with
    options as (
        select run as of_run,
            max(case when key = 'training.penetration_weight' then number end) as depths,
            max(case when key = 'training.contact_weight' then number end) as contact,
            max(case when key = 'training.augmentation' then value end) as augmentation,
            max(case when key = 'network.frame' then value end) as frame
        from settings where stage = 'train' and run in (select run from runs) group by run),
    kinds as (
        select of_run, case when frame like '%object%' then 5 when augmentation like '%none%' then 4
            when contact = 0 then 3 when depths = 0 then 2 else 1 end as place from options),
    tips as (
        select place as of_tips,
            1000 * avg(case when split = 'training' then tip_error_mean_m end) as learned_mm,
            1000 * avg(case when split = 'held_out' then tip_error_mean_m end) as held_out_mm,
            1000 * avg(case when split = 'unseen' then tip_error_mean_m end) as unseen_mm
        from all_reconstruction join kinds on all_reconstruction.run = kinds.of_run group by place),
    counts as (
        select place, case when stage = 'screen_drawn' then 1 else 0 end as drawn, object_split, object,
            1.0 * candidates_n as n, 1.0 * successes_n as s
        from all_success join kinds on all_success.run = kinds.of_run),
    by_object as (
        select place, drawn, object_split, object, 100 * sum(s) / sum(n) as share
        from counts group by place, drawn, object_split, object),
    defaults as (
        select drawn as of_drawn, object_split as of_split, object as of_object, share as default_share
        from by_object where place = 1),
    gains as (
        select place, drawn, object_split, share, share - default_share as gain
        from by_object join defaults on by_object.object = defaults.of_object and by_object.drawn = defaults.of_drawn
            and by_object.object_split = defaults.of_split),
    means as (
        select place, drawn, object_split, avg(share) as middle, avg(gain) as gain,
            case when count(*) = 20 then 2.093 when count(*) = 15 then 2.145 end
                * stddev(gain) / sqrt(1.0 * count(*)) as reach
        from gains group by place, drawn, object_split),
    shown as (
        select place as of_means,
            max(case when drawn = 1 and object_split = 'seen' then middle end) as drawn_seen,
            max(case when drawn = 1 and object_split = 'unseen' then middle end) as drawn_unseen,
            max(case when drawn = 0 and object_split = 'seen' then middle end) as seen,
            max(case when drawn = 0 and object_split = 'seen' then gain end) as seen_gain,
            max(case when drawn = 0 and object_split = 'seen' then reach end) as seen_reach,
            max(case when drawn = 0 and object_split = 'unseen' then middle end) as unseen,
            max(case when drawn = 0 and object_split = 'unseen' then gain end) as unseen_gain,
            max(case when drawn = 0 and object_split = 'unseen' then reach end) as unseen_reach
        from means group by place),
    names as (
        select * from (values
            (1, 'default'), (2, '`penetration_weight = 0`'), (3, '`contact_weight = 0`'),
            (4, '`augmentation = "none"`'), (5, '`frame = "object"` too')) as names(number, shown))
select
    names.shown as "training",
    round(learned_mm, 0) as "tips, learned, mm",
    round(held_out_mm, 0) as "held out, mm",
    round(unseen_mm, 0) as "unseen objects, mm",
    round(drawn_seen, 1) as "as sampled: succeed, seen, %",
    round(drawn_unseen, 1) as "as sampled: succeed, unseen, %",
    round(seen, 1) as "refined: succeed, seen, %",
    round(seen_gain, 1) as "difference",
    round(seen_gain - seen_reach, 1) as "from",
    round(seen_gain + seen_reach, 1) as "to",
    round(unseen, 1) as "refined: succeed, unseen, %",
    round(unseen_gain, 1) as "unseen: difference",
    round(unseen_gain - unseen_reach, 1) as "unseen: from",
    round(unseen_gain + unseen_reach, 1) as "unseen: to"
from shown join names on shown.of_means = names.number join tips on names.number = tips.of_tips
order by number
