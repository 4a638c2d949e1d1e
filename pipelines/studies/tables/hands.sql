-- The hands that come with the project: the fingertips' mean error after retargeting, and the refined motions that succeed
-- by the screen and by MuJoCo, as means over objects, and the share on which both agree.
--
-- pipeline run pipelines/studies/hands.toml --profile table_lift
with
    hands as (
        select run as of_run, case
            when overrides like '%allegro_right.toml%' then 1 when overrides like '%allegro_left.toml%' then 2
            when overrides like '%leap_right.toml%' then 3 else 4 end as place
        from runs where run in (select run from runs)),
    tips as (select place as tip_place, 1000 * avg(tip_error_mean_m) as tip_mm
        from all_tracking join hands on all_tracking.run = hands.of_run group by place),
    judged as (
        select run, object, candidate_id,
            sum(case when stage = 'screen' and success then 1 else 0 end) as ours,
            sum(case when stage = 'mujoco' and success then 1 else 0 end) as theirs
        from all_rollouts group by run, object, candidate_id),
    by_object as (
        select place, object, 1.0 * count(*) as n, 100.0 * avg(ours) as ours, 100.0 * avg(theirs) as theirs,
            100.0 * avg(case when ours = theirs then 1.0 else 0.0 end) as agree
        from judged join hands on judged.run = hands.of_run group by place, object),
    means as (select place, sum(n) as n, avg(ours) as ours, avg(theirs) as theirs, avg(agree) as agree
        from by_object group by place),
    names as (select * from (values (1, 'Allegro, right'), (2, 'Allegro, left'), (3, 'LEAP, right'), (4, 'Shadow, right'))
        as names(number, shown))
select
    shown as "hand",
    round(tip_mm, 1) as "tip error, mm",
    round(n, 0) as "motions",
    round(ours, 1) as "succeed, %",
    round(theirs, 1) as "by MuJoCo, %",
    round(agree, 1) as "both agree, %"
from means join tips on means.place = tips.tip_place join names on means.place = names.number
order by means.place
