-- What one noisy view costs: refined motions of the function of this repository to objects that are estimated from it, and to
-- true meshes, by `full_contact` on the true meshes: means over the objects of the share that succeeds; the best of 16 by the
-- residual. Four seeds, and so four views of each object.
--
-- pipeline run pipelines/studies/views.toml --set ingest.root=$DEXYCB --set camera.views_n=1 --set camera.noise.level=1.0 --set complete.completion=symmetry --set seed=1,2,3,4
with
    by_object as (
        select case when stage like '%true%' then 2 else 1 end as number, case when stage like '%best' then 1 else 0 end as best,
            object, object_split, 100.0 * sum(successes_n) / sum(candidates_n) as share
        from all_success where run in (select run from runs) group by stage, object, object_split),
    names as (select * from (values (1, 'one noisy view'), (2, 'the true mesh')) as names(number, shown))
select
    shown as "shape",
    round(avg(case when best = 0 and object_split = 'seen' then share end), 1) as "single samples, seen, %",
    round(avg(case when best = 0 and object_split = 'unseen' then share end), 1) as "single samples, unseen, %",
    round(avg(case when best = 1 and object_split = 'seen' then share end), 1) as "best of 16, seen, %",
    round(avg(case when best = 1 and object_split = 'unseen' then share end), 1) as "best of 16, unseen, %"
from by_object join names on by_object.number = names.number
group by by_object.number, shown
order by by_object.number
