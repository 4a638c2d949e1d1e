-- Success of the repository's function on DexYCB by protocol: success rates averaged over objects, for objects whose
-- names it has learned from (seen) and others (unseen). All rows have the same draws; one seed.
--
-- pipeline run pipelines/studies/pretrained.toml --set ingest.root=$DEXYCB
with
    judges as (
        select distinct run, stage, protocol from all_rates where run in (select run from runs)),
    by_object as (
        select protocol, all_success.stage as stage, object, object_split, sum(candidates_n) as n,
            100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success join judges on all_success.run = judges.run and all_success.stage = judges.stage
        group by protocol, all_success.stage, object, object_split),
    names as (
        select * from (values
            (1, 'screen_drawn', 'as sampled'),
            (2, 'screen', 'refined'),
            (3, 'screen_best', 'refined, best of four')) as names(number, judge, motions))
select
    '`' || protocol || '`' as "protocol", motions as "motions", sum(n) as "candidates",
    round(avg(case when object_split = 'seen' then share end), 1) as "succeed, seen, %",
    round(avg(case when object_split = 'unseen' then share end), 1) as "succeed, unseen, %",
    round(min(case when object_split = 'unseen' then share end)) as "least unseen object, %"
from by_object join names on stage = judge
group by protocol, number, motions
order by case when protocol = 'full_contact' then 0 else 1 end, protocol, number
