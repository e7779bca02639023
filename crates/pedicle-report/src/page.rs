//! The page as a whole.

use std::fmt::Write;

use crate::block::Tone;
use crate::chart::STANDALONE_STYLE;
use crate::escape::{escaped, inside_script};
use crate::{Scene, Section};

const STYLE: &str = include_str!("../assets/page.css");
const CONTROLS: &str = include_str!("../assets/viewer.html");
const SCRIPTS: [&str; 5] = [
    include_str!("../assets/page.js"),
    include_str!("../assets/math.js"),
    include_str!("../assets/renderer.js"),
    include_str!("../assets/controls.js"),
    include_str!("../assets/viewer.js"),
];

/// A figure at the top of the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact {
    /// What it is.
    pub name: String,
    /// The value, short.
    pub value: String,
    /// How good it is; `None` if that is not said.
    pub tone: Option<Tone>,
}

/// A report.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Page {
    /// The heading.
    pub title: String,
    /// A sentence below it.
    pub subtitle: String,
    /// The figures that matter most.
    pub facts: Vec<Fact>,
    /// The 3-D view, if there is one.
    pub scene: Option<Scene>,
    /// Everything else.
    pub sections: Vec<Section>,
}

impl Page {
    /// A page with a heading and nothing else.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            ..Self::default()
        }
    }

    /// Adds a figure at the top.
    pub fn fact(&mut self, name: &str, value: impl Into<String>, tone: Option<Tone>) {
        self.facts.push(Fact {
            name: name.to_owned(),
            value: value.into(),
            tone,
        });
    }

    /// The page as one HTML file without any reference to another.
    #[must_use]
    pub fn html(&self) -> String {
        let mut html = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <link rel=\"icon\" href=\"data:,\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <a class=\"skip\" href=\"#main\">Skip to the report</a>\n\
             <header class=\"top\"><div><h1>{title}</h1><p>{subtitle}</p></div>\
             <div class=\"top-buttons\"><button type=\"button\" id=\"theme\">Dark</button>\
             <button type=\"button\" id=\"print\">Print</button></div></header>\n",
            title = escaped(&self.title),
            subtitle = escaped(&self.subtitle),
        );
        html.push_str(&self.navigation());
        html.push_str("<main id=\"main\">\n");
        html.push_str(&self.facts_html());
        if self.scene.is_some() {
            html.push_str(CONTROLS);
        }
        for section in &self.sections {
            html.push_str(&section.html());
        }
        html.push_str(
            "</main>\n<footer><p>Research software. Not a medical device; not for clinical use.</p></footer>\n",
        );
        let _ = writeln!(
            html,
            "<script type=\"text/plain\" id=\"figure-style\">{STANDALONE_STYLE}</script>"
        );
        if let Some(scene) = &self.scene {
            let _ = writeln!(
                html,
                "<script type=\"application/json\" id=\"scene\">{}</script>",
                inside_script(&scene.json())
            );
        }
        for script in SCRIPTS {
            let _ = write!(html, "<script>\n{script}</script>\n");
        }
        html + "</body>\n</html>\n"
    }

    fn navigation(&self) -> String {
        let view = self.scene.as_ref().map(|_| ("view", "3-D view"));
        let sections = self
            .sections
            .iter()
            .map(|s| (s.id.as_str(), s.title.as_str()));
        let links: String = view
            .into_iter()
            .chain(sections)
            .map(|(id, title)| format!("<li><a href=\"#{id}\">{}</a></li>", escaped(title)))
            .collect();
        format!("<nav aria-label=\"Parts of the report\"><ul>{links}</ul></nav>\n")
    }

    fn facts_html(&self) -> String {
        if self.facts.is_empty() {
            return String::new();
        }
        let facts: String = self
            .facts
            .iter()
            .map(|fact| {
                let value = fact
                    .tone
                    .map_or_else(|| escaped(&fact.value), |tone| tone.badge(&fact.value));
                format!(
                    "<div><dt>{}</dt><dd>{value}</dd></div>",
                    escaped(&fact.name)
                )
            })
            .collect();
        format!("<dl class=\"facts\">{facts}</dl>\n")
    }
}
