//! The player with its list of motions.

use charts::escaped;

use crate::{Motion, PageData, numbers::words};

/// The player with its list of motions.
pub(super) fn motions(gathered: &PageData) -> String {
    let mut text = String::from(
        "<section id=\"motions\" aria-labelledby=\"motions-title\">\n<h2 id=\"motions-title\">Motions</h2>\n",
    );
    let all = &gathered.motions;
    if all.is_empty() {
        text.push_str(
            "<p>No rollout of this run has a recording: nothing was screened, or <code>recorded_per_object</code> of \
             the screen is 0.</p>\n</section>\n",
        );
        return text;
    }
    let rollouts_n = gathered.rollouts.values().flatten().count();
    text.push_str(&format!(
        "<p>{} of {} recorded rollouts, of {rollouts_n}: one of each reason for failing, a success of each object, near \
         misses. Blue: the hand. Purple, transparent: where its joints were commanded. Orange: the object. Black: contacts, \
         larger with more force. Drag to turn, with the right button or Shift to shift, scroll to zoom.</p>\n",
        all.len(),
        gathered.recorded_n
    ));
    text.push_str(&filters(all));
    text.push_str(
        "<div class=\"player\">\n<div class=\"stage\">\n\
         <canvas id=\"view\" width=\"960\" height=\"600\" role=\"img\" tabindex=\"0\" \
         aria-label=\"The motion in three dimensions\"></canvas>\n\
         <p id=\"no-webgl\" hidden>This browser draws no 3D (WebGL 2 is missing or switched off).</p>\n\
         <p id=\"motion-name\" role=\"status\"></p>\n\
         <div class=\"controls\">\n\
         <button type=\"button\" id=\"previous\" title=\"Previous motion (P)\">Previous</button>\n\
         <button type=\"button\" id=\"play\" title=\"Play or pause (space)\">Play</button>\n\
         <button type=\"button\" id=\"next\" title=\"Next motion (N)\">Next</button>\n\
         <label for=\"scrub\" class=\"grow\">Time <input type=\"range\" id=\"scrub\" min=\"0\" max=\"1\" step=\"0.001\" value=\"0\"></label>\n\
         <output id=\"time\" for=\"scrub\">0.00 s</output>\n\
         <label for=\"speed\">Speed <select id=\"speed\"><option value=\"0.1\">0.1</option><option value=\"0.25\">0.25</option>\
         <option value=\"0.5\">0.5</option><option value=\"1\" selected>1</option><option value=\"2\">2</option></select></label>\n\
         <label for=\"camera\">View <select id=\"camera\"><option value=\"oblique\">oblique</option><option value=\"front\">front</option>\
         <option value=\"side\">side</option><option value=\"top\">top</option></select></label>\n\
         <label for=\"ghost\"><input type=\"checkbox\" id=\"ghost\" checked> Command</label>\n\
         <label for=\"contacts\"><input type=\"checkbox\" id=\"contacts\" checked> Contacts</label>\n\
         <label for=\"follow\"><input type=\"checkbox\" id=\"follow\" checked> Follow</label>\n\
         </div>\n\
         <p class=\"keys\">Keys: space plays, N and P change the motion, comma and point step, \
         arrow keys turn the view while it is in focus.</p>\n\
         </div>\n<ol id=\"list\">\n",
    );
    text.push_str(&list(all));
    text.push_str("</ol>\n</div>\n</section>\n");
    text
}

/// Returns the filters of the list.
fn filters(all: &[Motion]) -> String {
    let mut text = String::new();
    let select = |id: &str, label: &str, values: Vec<(String, String)>| {
        let options = values.iter();
        let options = options.map(|(value, shown)| {
            format!(
                "<option value=\"{}\">{}</option>",
                escaped(value),
                escaped(shown)
            )
        });
        let options = options.collect::<Vec<_>>().concat();
        format!(
            "<label for=\"{id}\">{label} <select id=\"{id}\"><option value=\"\">all</option>{options}</select></label>\n"
        )
    };
    let distinct = |of: &dyn Fn(&Motion) -> (String, String)| -> Vec<(String, String)> {
        let mut values: Vec<(String, String)> = all.iter().map(of).collect();
        values.sort();
        values.dedup();
        values
    };
    text.push_str("<div class=\"filters\">\n");
    text.push_str(&select(
        "filter-object",
        "Object",
        distinct(&|one| (one.object.clone(), one.object.clone())),
    ));
    text.push_str(&select(
        "filter-verdict",
        "Verdict",
        distinct(&|one| (one.verdict.clone(), words(&one.verdict))),
    ));
    let outcome = |one: &Motion| {
        let word = one.outcome.as_str();
        (word.to_owned(), word.to_owned())
    };
    text.push_str(&select("filter-outcome", "Outcome", distinct(&outcome)));
    text.push_str(&select(
        "filter-generator",
        "Generator",
        distinct(&|one| (one.generator.clone(), one.generator.clone())),
    ));
    text.push_str("<span id=\"shown-count\" role=\"status\"></span>\n</div>\n");
    text
}

/// A button for each motion.
fn list(all: &[Motion]) -> String {
    let mut text = String::new();
    for (idx, motion) in all.iter().enumerate() {
        let outcome = motion.outcome.as_str();
        text.push_str(&format!(
            "<li><button type=\"button\" id=\"motion-{idx}\" class=\"motion {}\" data-idx=\"{idx}\" data-id=\"{}\" data-object=\"{}\" \
             data-verdict=\"{}\" data-outcome=\"{outcome}\" data-generator=\"{}\" data-recording=\"{}\">\
             <span>{}</span> <span class=\"verdict\">{}</span></button></li>\n",
            outcome.replace(' ', "-"),
            escaped(&motion.id),
            escaped(&motion.object),
            escaped(&motion.verdict),
            escaped(&motion.generator),
            escaped(motion.recording.as_deref().unwrap_or_default()),
            escaped(&motion.id),
            escaped(&words(&motion.verdict)),
        ));
    }
    text
}
