//! Why candidates fail.

use charts::{Bars, Captions, bars};
use schemas::rollouts::Verdict;

use crate::{
    PageData,
    funnel::verdicts,
    numbers::words,
    table::{Cell, DataTable, Section},
};

fn meaning(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Held => "lifted and held to the end",
        Verdict::Limit => "a commanded joint position violates its limits",
        Verdict::Table => "the motion would pass through the table",
        Verdict::EarlyContact => "the motion would pass through the object before the grasp",
        Verdict::KnockedOver => "the object was pushed away or over before it was lifted",
        Verdict::NotGrasped => "nothing was lifted",
        Verdict::Slipped => "the object moved in the hand while it was held",
        Verdict::Dropped => "lifted, and fell before the end",
        Verdict::TooDeep => {
            "held, with the hand deeper in the object or in itself than solid bodies can be"
        }
        Verdict::Overloaded => {
            "object and table loaded the palm, or pushed it off its path, more than an arm withstands"
        }
        Verdict::Diverged => "the simulation became non-finite or implausible",
        Verdict::Infeasible => "the hand cannot execute the motion; nothing was simulated",
    }
}

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("failures", "Failures");
    let verdicts = verdicts(gathered);
    let all_n: i64 = verdicts.values().sum();
    let failed: Vec<(Verdict, i64)> = verdicts
        .into_iter()
        .filter(|(verdict, _)| *verdict != Verdict::Held)
        .collect();
    if all_n == 0 {
        section.say("Nothing was screened in this run.");
        return section;
    }
    if failed.is_empty() {
        section.say(format!("None of {all_n} candidates failed."));
        return section;
    }
    let failed_n: i64 = failed.iter().map(|(_, n)| n).sum();
    section.say(format!(
        "{failed_n} of {all_n} candidates failed. A click on a reason shows its motions; motions refused on geometry \
         alone have none."
    ));
    let mut table = DataTable::new(
        "by_reason",
        "Candidates by the reason for failing",
        &[
            ("reason", "Reason"),
            ("n", "Candidates"),
            ("share", "Of all"),
            ("motions_n", "Motions here"),
            ("meaning", "Meaning"),
        ],
    );
    let mut failed = failed;
    failed.sort_by_key(|(verdict, n)| (-n, *verdict));
    for (verdict, n) in &failed {
        let shown = gathered.motions.iter();
        let shown = shown.filter(|motion| motion.verdict == verdict.as_str());
        table.row([
            Cell::Link {
                filter: "verdict",
                value: verdict.as_str().to_owned(),
                shown: words(verdict.as_str()),
            },
            Cell::count(*n),
            Cell::share(*n as f64 / all_n as f64),
            Cell::count(crate::numbers::signed(shown.count())),
            Cell::text(meaning(*verdict)),
        ]);
    }
    let captions = Captions {
        title: "Candidates that fail, by reason",
        x: "candidates",
        y: "",
    };
    let names: Vec<String> = failed
        .iter()
        .map(|(verdict, _)| words(verdict.as_str()))
        .collect();
    let series = Bars {
        name: String::new(),
        values: failed
            .iter()
            .map(|(verdict, n)| (words(verdict.as_str()), *n as f64))
            .collect(),
    };
    section.chart(
        "Number of candidates that fail, by reason",
        bars(&captions, &names, &[series]),
    );
    section.tables.push(table);
    section
}
