-- What the function of this repository reaches on DexYCB: means over the objects of the share of motions that succeed, of
-- those whose name it has learned from and of the others. The same draws in all rows; one seed.
--
-- pipeline run pipelines/studies/pretrained.toml --set ingest.root=$DEXYCB
with
    by_object as (
        select stage, object, object_split, sum(candidates_n) as n,
            100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success where run in (select run from runs) group by stage, object, object_split),
    names as (
        select * from (values
            (1, 'screen_drawn', 'as sampled, scripted squeeze', '`full_contact`'),
            (2, 'screen', 'refined', '`full_contact`'),
            (3, 'screen_best', 'refined, best of four', '`full_contact`'),
            (4, 'screen_drawn_tabletop', 'as sampled, scripted squeeze', '`dexgraspbench_tabletop`'),
            (5, 'screen_tabletop', 'refined', '`dexgraspbench_tabletop`'),
            (6, 'screen_force_closure', 'refined', '`dexgraspbench_force_closure`'),
            (7, 'screen_paper', 'refined', '`paper`')) as names(number, stage, motions, protocol))
select
    motions as "motions", protocol as "protocol", sum(n) as "candidates",
    round(avg(case when object_split = 'seen' then share end), 1) as "succeed, seen, %",
    round(avg(case when object_split = 'unseen' then share end), 1) as "succeed, unseen, %",
    round(min(case when object_split = 'unseen' then share end)) as "least unseen object, %"
from by_object join names on by_object.stage = names.stage
group by number, motions, protocol
order by number
