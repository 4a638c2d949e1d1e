-- Demonstrations carried out unchanged, and refined motions of the prior, single samples and the best of four, of functions
-- that have seen the object, and that have not (five seeds, four folds of the objects). The 95 % interval is that of the
-- objects' mean, Student's over the 20 objects' own rates. The paper's share is derived: 65 control steps of a trial
-- over its cost (Ye et al., RA-L 2023, table V).
--
-- pipeline run pipelines/replay.toml --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/refinement.toml --set ingest.root=$DEXYCB
with
    options as (
        select run as of_run, max(case when stage = 'refine' and key = 'draws' then number end) as best_of,
            max(case when stage = 'screen' and key = 'pose_error.position_m' then number end) as error_m
        from settings where run in (select run from runs) group by run),
    by_object as (
        select origin, case when best_of > 1 then 4 else 1 end as best_of, object_split, object, 1.0 * sum(draws_n) as d,
            1.0 * sum(candidates_n) as c, 1.0 * sum(successes_n) as s
        from all_success left join options on all_success.run = options.of_run
        where run in (select run from runs) and error_m = 0
        group by origin, case when best_of > 1 then 4 else 1 end, object_split, object),
    shares as (select *, case when c > 0 then s / c end as share from by_object),
    groups as (
        select origin, best_of, object_split, count(share) as objects_n, sum(d) as draws, sum(c) as motions,
            100 * sum(s) / sum(c) as by_motion, 100 * sum(s) / sum(d) as by_draw,
            100 * avg(share) as middle,
            case when count(share) = 20 then 209.3 * stddev(share) / sqrt(20.0) end as reach
        from shares group by origin, best_of, object_split),
    names as (
        select * from (values
            (0, 'demonstration', 1, '', 'demonstrations', 'all', '-'),
            (1, 'prior', 1, 'seen', 'refined, single samples', 'seen', '0.33'),
            (2, 'prior', 1, 'unseen', 'refined, single samples', 'unseen', '0.42'),
            (3, 'prior', 4, 'seen', 'refined, best of four', 'seen', '0.33'),
            (4, 'prior', 4, 'unseen', 'refined, best of four', 'unseen', '0.42'))
            as names(place, of_origin, of_best, of_split, shown, objects, paper_share))
select
    shown as "motions",
    objects_n || ' ' || objects as "objects",
    round(draws, 0) as "samples",
    round(motions, 0) as "candidates",
    round(by_draw, 1) as "succeed, by sample, %",
    round(by_motion, 1) as "by candidate, %",
    round(middle, 1) as "objects' mean, %",
    round(middle - reach, 1) as "from, %",
    round(middle + reach, 1) as "to, %",
    paper_share as "the paper's, derived, %"
from groups join names on groups.origin = names.of_origin and groups.best_of = names.of_best
    and coalesce(groups.object_split, '') = names.of_split
order by place
