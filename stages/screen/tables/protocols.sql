-- Single samples and demonstrations by protocol: the mean over objects of the share of samples that succeeds, with
-- Student's 95 % interval over the objects, each over all its folds and seeds; how far the means of single seeds
-- spread; and the difference to `table_lift` with palm and fingers following the motion, paired by object.
--
-- pipeline run pipelines/studies/protocols.toml --profile table_lift --set ingest.root=$DEXYCB
with
    protocols as (
        select distinct run, stage, protocol, approach, friction, torque_limit_nm, object_mass
        from all_rates where run in (select run from runs)),
    -- Demonstrations are the same in every run.
    counts as (
        select distinct protocol, approach, friction, torque_limit_nm, object_mass, origin, object_split, object,
            case when origin = 'demonstration' then 0 else all_success.run end as one,
            case when origin = 'demonstration' then 0 else seed end as seed,
            1.0 * draws_n as d, 1.0 * successes_n as s, 1.0 * (limit_n + table_n + early_contact_n) as refused
        from all_success
        join protocols on all_success.run = protocols.run and all_success.stage = protocols.stage
        join runs on all_success.run = runs.run),
    by_object as (
        select protocol, approach, friction, torque_limit_nm, object_mass, origin, object_split, object,
            sum(d) as d, 100 * sum(s) / sum(d) as share,
            case when sum(d) > sum(refused) then 100 * sum(s) / (sum(d) - sum(refused)) end as simulated
        from counts group by protocol, approach, friction, torque_limit_nm, object_mass, origin, object_split, object),
    ours as (
        select origin as our_origin, object_split as our_split, object as our_object, share as our_share
        from by_object where protocol = 'table_lift' and approach = 'follow'),
    paired as (
        select by_object.*, share - our_share as more
        from by_object join ours on origin = our_origin and object = our_object
            and coalesce(object_split, '') = coalesce(our_split, '')),
    by_seed as (
        select protocol, approach, origin, object_split, seed, avg(100 * s / d) as share
        from counts group by protocol, approach, origin, object_split, seed),
    seeds as (
        select protocol as of_protocol, approach as of_approach, origin as of_origin, object_split as of_split,
            count(share) as seeds_n, stddev(share) as spread
        from by_seed group by protocol, approach, origin, object_split),
    quantiles as (
        select * from (values (20, 2.093), (19, 2.101), (18, 2.110), (17, 2.120), (16, 2.131), (15, 2.145))
            as quantiles(n, t)),
    means as (
        select protocol, approach, friction, torque_limit_nm, object_mass, origin, object_split,
            count(share) as objects_n, sum(d) as d, avg(simulated) as simulated,
            avg(share) as share, stddev(share) / sqrt(1.0 * count(share)) as deviation,
            avg(more) as more, stddev(more) / sqrt(1.0 * count(more)) as deviation_of_more
        from paired group by protocol, approach, friction, torque_limit_nm, object_mass, origin, object_split),
    shown as (
        select * from (values
            (0, 'demonstration', '', 'demonstrations'), (1, 'posterior', 'seen', 'posterior, seen'),
            (2, 'prior', 'seen', 'prior, seen'), (3, 'prior', 'unseen', 'prior, unseen'))
            as shown(place, shown_origin, shown_split, motions)),
    all_places as (
        select * from (values
            (0, 'table_lift', 'follow'), (1, 'table_lift', 'open'), (2, 'paper', 'follow'),
            (3, 'dexgraspbench_tabletop', 'at_grasp'), (4, 'dexgraspbench_force_closure', 'at_grasp'))
            as all_places(protocol_place, placed_protocol, placed_approach))
select
    '`' || protocol || '`, ' || approach as "protocol",
    round(friction, 1) as "friction",
    round(torque_limit_nm, 1) as "torque limit, Nm",
    object_mass as "masses",
    motions as "motions",
    objects_n as "objects",
    round(d, 0) as "samples",
    round(share, 1) as "succeed, %",
    round(share - t * deviation, 1) as "from",
    round(share + t * deviation, 1) as "to",
    round(simulated, 1) as "of those simulated, %",
    case when seeds_n > 1 then round(spread, 1) end as "seeds' deviation",
    case when protocol_place > 0 then round(more, 1) end as "difference",
    case when protocol_place > 0 then round(more - t * deviation_of_more, 1) end as "at least",
    case when protocol_place > 0 then round(more + t * deviation_of_more, 1) end as "at most"
from means
join quantiles on objects_n = n
join shown on origin = shown_origin and coalesce(object_split, '') = shown_split
join all_places on protocol = placed_protocol and approach = placed_approach
join seeds on protocol = of_protocol and approach = of_approach and origin = of_origin
    and coalesce(object_split, '') = coalesce(of_split, '')
order by protocol_place, place
