//! Tables.

use std::fmt::Write;

use crate::escape::{csv_field, escaped};

/// Rows of text under a header. Columns whose cells are numbers are set to the right.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// What it shows; read out by screen readers.
    pub caption: String,
    /// Names of the columns.
    pub header: Vec<String>,
    /// As many cells a row as the header has.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    #[must_use]
    pub fn new(caption: &str, header: &[&str]) -> Self {
        Self {
            caption: caption.to_owned(),
            header: header.iter().map(|&h| h.to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn push<T: Into<String>>(&mut self, row: impl IntoIterator<Item = T>) {
        self.rows.push(row.into_iter().map(Into::into).collect());
    }

    /// The table as comma-separated values, header first.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::new();
        for row in std::iter::once(&self.header).chain(&self.rows) {
            let fields: Vec<String> = row.iter().map(|field| csv_field(field)).collect();
            text.push_str(&fields.join(","));
            text.push('\n');
        }
        text
    }

    pub(crate) fn html(&self) -> String {
        let numeric: Vec<bool> = (0..self.header.len()).map(|c| self.is_numeric(c)).collect();
        let mut html = format!(
            "<div class=\"table-scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\">\
             <table><caption>{0}</caption><thead><tr>",
            escaped(&self.caption)
        );
        let class = |c: usize| if numeric[c] { " class=\"number\"" } else { "" };
        for (c, name) in self.header.iter().enumerate() {
            let _ = write!(html, "<th scope=\"col\"{}>{}</th>", class(c), escaped(name));
        }
        html.push_str("</tr></thead><tbody>");
        for row in &self.rows {
            html.push_str("<tr>");
            for (c, cell) in row.iter().enumerate() {
                let cell = escaped(cell);
                let _ = if c == 0 {
                    write!(html, "<th scope=\"row\">{cell}</th>")
                } else {
                    let class = numeric.get(c).map_or("", |_| class(c));
                    write!(html, "<td{class}>{cell}</td>")
                };
            }
            html.push_str("</tr>");
        }
        html + "</tbody></table></div>"
    }

    /// Whether a column starts with digits, or signs of them, wherever it is not empty.
    fn is_numeric(&self, column: usize) -> bool {
        let mut cells = self.rows.iter().filter_map(|row| row.get(column));
        cells.all(|cell| {
            cell.is_empty()
                || cell == "–"
                || cell.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '-' | '−' | '<'))
        })
    }
}
