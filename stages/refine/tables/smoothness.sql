-- How smooth refined motions are, single samples of the prior, beside the retargeted demonstrations, by each definition of
-- `smoothness`: means over the motions, of velocity and acceleration their logarithm to base 10.
--
-- pipeline run pipelines/replay.toml --profile table_lift --set ingest.root=$DEXYCB
-- pipeline run pipelines/studies/refinement.toml --profile table_lift --set ingest.root=$DEXYCB --set seed=1 \
--   --set sample.per_object=20 --set refine.draws=1
with
    motions as (
        select case when pipeline = 'replay' then 'demonstrations' else 'refined' end as motions, *
        from all_smoothness where run in (select run from runs)),
    means as (
        select 1 as number, 'the paper''s' as definition, motions,
            avg(paper_joints_position) as joints_0, log10(avg(paper_joints_velocity)) as joints_1, log10(avg(paper_joints_acceleration)) as joints_2,
            avg(paper_cartesian_position) as links_0, log10(avg(paper_cartesian_velocity)) as links_1, log10(avg(paper_cartesian_acceleration)) as links_2
        from motions group by motions
        union all
        select 2 as number, 'the released code''s' as definition, motions,
            avg(released_joints_position) as joints_0, log10(avg(released_joints_velocity)) as joints_1, log10(avg(released_joints_acceleration)) as joints_2,
            avg(released_cartesian_position) as links_0, log10(avg(released_cartesian_velocity)) as links_1, log10(avg(released_cartesian_acceleration)) as links_2
        from motions group by motions
        union all
        select 3 as number, 'robust' as definition, motions,
            avg(robust_joints_position) as joints_0, log10(avg(robust_joints_velocity)) as joints_1, log10(avg(robust_joints_acceleration)) as joints_2,
            avg(robust_cartesian_position) as links_0, log10(avg(robust_cartesian_velocity)) as links_1, log10(avg(robust_cartesian_acceleration)) as links_2
        from motions group by motions)
select
    definition || ', ' || motions as "definition, motions",
    round(joints_0, 2) as "joints: position",
    round(joints_1, 2) as "joints: velocity",
    round(joints_2, 2) as "joints: acceleration",
    round(links_0, 2) as "links: position",
    round(links_1, 2) as "links: velocity",
    round(links_2, 2) as "links: acceleration"
from means order by number, motions desc
