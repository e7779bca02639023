//! What a section of a page is made of.

use crate::Table;
use crate::escape::{escaped, inside_script, slug};

/// A part of a page with a heading.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// Name of the anchor.
    pub id: String,
    /// The heading.
    pub title: String,
    /// What is in it, in its order.
    pub blocks: Vec<Block>,
}

/// One element of a section.
#[derive(Debug, Clone, PartialEq)]
pub enum Block {
    /// A paragraph.
    Text(String),
    /// Sentences as a list.
    List(Vec<String>),
    /// A table.
    Table(Table),
    /// Figures side by side where there is room.
    Figures(Vec<Figure>),
    /// Cards side by side where there is room.
    Cards(Vec<Card>),
}

/// A picture with its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What it shows; also the name of the files that are saved.
    pub title: String,
    /// How to read it.
    pub caption: String,
    /// The picture: an `<svg>` element as the functions of [`chart`](crate::chart) draw it.
    pub svg: String,
    /// The numbers behind it.
    pub csv: String,
}

/// How good something is; never told by colour alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// As it should be.
    Good,
    /// To be looked at.
    Warning,
    /// Not to be used.
    Bad,
}

/// One thing with its verdict, figures and facts, such as a screw.
#[derive(Debug, Clone, PartialEq)]
pub struct Card {
    /// Its name.
    pub title: String,
    /// The verdict in one or two words.
    pub verdict: String,
    /// How good that is.
    pub tone: Tone,
    /// Sentences that tell why.
    pub reasons: Vec<String>,
    /// Names and values.
    pub facts: Vec<(String, String)>,
    /// Its figures.
    pub figures: Vec<Figure>,
    /// Name of a screw of the scene that a button of the card shows; `None` for no button.
    pub shows: Option<String>,
}

impl Section {
    /// A section without blocks. `id` is a word of lower-case letters and hyphens.
    #[must_use]
    pub fn new(id: &str, title: &str) -> Self {
        Self {
            id: slug(id),
            title: title.to_owned(),
            blocks: Vec::new(),
        }
    }

    /// The section with one more block.
    #[must_use]
    pub fn with(mut self, block: Block) -> Self {
        self.blocks.push(block);
        self
    }

    pub(crate) fn html(&self) -> String {
        let blocks: String = self.blocks.iter().map(Block::html).collect();
        format!(
            "<section id=\"{0}\" aria-labelledby=\"{0}-heading\"><h2 id=\"{0}-heading\">{1}</h2>{blocks}</section>\n",
            self.id,
            escaped(&self.title)
        )
    }
}

impl Block {
    fn html(&self) -> String {
        match self {
            Self::Text(text) => format!("<p>{}</p>", escaped(text)),
            Self::List(sentences) => list("sentences", sentences),
            Self::Table(table) => format!(
                "<div class=\"data\">{}{}</div>",
                table.html(),
                saving(&table.caption, None, &table.csv())
            ),
            Self::Figures(figures) => {
                let figures: String = figures.iter().map(Figure::html).collect();
                format!("<div class=\"figures\">{figures}</div>")
            }
            Self::Cards(cards) => {
                let cards: String = cards.iter().map(Card::html).collect();
                format!("<div class=\"cards\">{cards}</div>")
            }
        }
    }
}

fn list(class: &str, sentences: &[String]) -> String {
    let items: String = sentences
        .iter()
        .map(|s| format!("<li>{}</li>", escaped(s)))
        .collect();
    format!("<ul class=\"{class}\">{items}</ul>")
}

impl Figure {
    fn html(&self) -> String {
        format!(
            "<figure>{}<figcaption><strong>{}</strong> {}</figcaption>{}</figure>",
            self.svg,
            escaped(&self.title),
            escaped(&self.caption),
            saving(&self.title, Some("SVG"), &self.csv)
        )
    }
}

/// Buttons that save what stands before them.
fn saving(title: &str, svg: Option<&str>, csv: &str) -> String {
    let (name, title) = (slug(title), escaped(title));
    let button = |kind: &str, what: &str| {
        format!(
            "<button type=\"button\" class=\"quiet\" data-save=\"{what}\" data-name=\"{name}\" \
             aria-label=\"Save {title} as {kind}\">{kind}</button>"
        )
    };
    let svg = svg.map_or_else(String::new, |kind| button(kind, "svg"));
    format!(
        "<div class=\"saving\">{svg}{}<script type=\"text/csv\">{}</script></div>",
        button("CSV", "csv"),
        inside_script(csv)
    )
}

impl Tone {
    fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Warning => "warning",
            Self::Bad => "bad",
        }
    }

    fn sign(self) -> &'static str {
        match self {
            Self::Good => "✓",
            Self::Warning => "!",
            Self::Bad => "✕",
        }
    }

    /// The words in a coloured box, with a sign.
    pub(crate) fn badge(self, words: &str) -> String {
        format!(
            "<span class=\"badge {}\"><span aria-hidden=\"true\">{}</span> {}</span>",
            self.class(),
            self.sign(),
            escaped(words)
        )
    }
}

impl Card {
    fn html(&self) -> String {
        let facts: String = self
            .facts
            .iter()
            .map(|(name, value)| {
                format!(
                    "<div><dt>{}</dt><dd>{}</dd></div>",
                    escaped(name),
                    escaped(value)
                )
            })
            .collect();
        let figures: String = self.figures.iter().map(Figure::html).collect();
        let shows = self.shows.as_ref().map_or_else(String::new, |screw| {
            format!(
                "<button type=\"button\" class=\"quiet\" data-show=\"{0}\" aria-label=\"Show {0} in the 3-D view\">Show in 3-D</button>",
                escaped(screw)
            )
        });
        let reasons = if self.reasons.is_empty() {
            String::new()
        } else {
            list("reasons", &self.reasons)
        };
        format!(
            "<article class=\"card\"><header><h3>{}</h3>{}{shows}</header>{reasons}\
             <dl>{facts}</dl><div class=\"pair\">{figures}</div></article>",
            escaped(&self.title),
            self.tone.badge(&self.verdict),
        )
    }
}
