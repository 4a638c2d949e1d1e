-- Expert iteration: single draws of the prior of each function, refined, and as drawn with the scripted squeeze: means
-- over the objects of the share that holds. Fifteen objects are seen, five unseen; the second fold, which the defaults
-- were not chosen on.
--
-- pipeline run pipelines/expert.toml --set ingest.root=$DEXYCB --set train.unseen_fold=2/4 --set train_longer.unseen_fold=2/4 --set train_1.unseen_fold=2/4 --set train_2.unseen_fold=2/4
with
    names as (
        select * from (values
            (1, '', 'demonstrations'), (2, '_longer', 'demonstrations, twice as many epochs'),
            (3, '_1', 'and accepted motions of the first'), (4, '_2', 'and accepted motions of the third'))
            as names(number, suffix, shown)),
    counts as (
        select number, shown, object, object_split, 1.0 * candidates_n as n, 1.0 * successes_n as s,
            case when substr(stage, 1, 12) = 'screen_drawn' then 1 else 0 end as drawn
        from all_success, names
        where run in (select run from runs)
            and (stage = 'screen' || suffix or stage = 'screen_drawn' || suffix)),
    by_object as (
        select number, shown, object, object_split, drawn, 100 * sum(s) / sum(n) as share
        from counts group by number, shown, object, object_split, drawn)
select
    shown as "learned from",
    round(avg(case when drawn = 0 and object_split = 'seen' then share end), 1) as "refined: hold, seen, %",
    round(avg(case when drawn = 0 and object_split = 'unseen' then share end), 1) as "refined: hold, unseen, %",
    round(avg(case when drawn = 1 and object_split = 'seen' then share end), 1) as "as drawn: hold, seen, %",
    round(avg(case when drawn = 1 and object_split = 'unseen' then share end), 1) as "as drawn: hold, unseen, %"
from by_object group by number, shown order by number
