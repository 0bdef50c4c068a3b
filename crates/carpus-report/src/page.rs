//! The report page: template, styles and script put together under a content security policy.

use askama::Template;

use super::live::Live;
use super::next_steps::{NextStep, next_steps};
use super::policy::{SCRIPT, STYLE, content_security_policy};
use super::results::Results;
use super::story::Story;
use super::story_figures::standing_alone;
use super::view::View;
use carpus_numerics::printable::visible_lines;

#[derive(Template)]
#[template(path = "report.html")]
struct Page<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    view: View,
    results: &'a Results,
    live: Option<Live<'a>>,
    next: Vec<NextStep>,
}

#[derive(Template)]
#[template(path = "story.html")]
struct StoryPage<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    view: Story,
    results: &'a Results,
    live: Option<Live<'a>>,
    next: Vec<NextStep>,
}

/// The report of a results file: one self-contained HTML page.
pub fn render_report(results: &Results) -> String {
    let live = Live::of(results);
    let policy = live.as_ref().map_or_else(content_security_policy, |live| live.embedded.content_security_policy());
    let next = next_steps(results, "");
    if let Some(story) = Story::new(results) {
        let page = StoryPage { policy, style: STYLE, script: SCRIPT, view: story, results, live, next };
        return finished(&page);
    }
    let page = Page { policy, style: STYLE, script: SCRIPT, view: View::new(results), results, live, next };
    finished(&page)
}

/// The text of a page, characters of names that would change how it is shown written out.
pub(super) fn finished(page: &impl Template) -> String {
    let text = page.render().expect("no template has a failing filter");
    visible_lines(&text).into_owned()
}

/// The fall of the error as a figure of its own (SVG); `None` for results that have no diagnosis.
pub fn render_waterfall(results: &Results) -> Option<String> {
    Story::new(results).map(|story| standing_alone(&story.waterfall))
}
