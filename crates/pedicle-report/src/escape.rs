//! Text made safe inside HTML, SVG and CSV.

/// Text for an element or an attribute in double quotes.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // Characters that HTML and XML do not allow.
            c if c.is_control() && !matches!(c, '\n' | '\t') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// Text inside a `<script>` that is no script: nothing in it may end the element.
pub(crate) fn inside_script(text: &str) -> String {
    text.replace('<', "\\u003c")
}

/// One field of a CSV file (RFC 4180).
pub(crate) fn csv_field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// Lower case letters and digits joined by hyphens, for names of files and elements.
pub(crate) fn slug(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c.to_ascii_lowercase());
        } else if !out.is_empty() && !out.ends_with('-') {
            out.push('-');
        }
    }
    out.trim_end_matches('-').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_breaks_out() {
        assert_eq!(
            escaped("<b a=\"'&\u{0}"),
            "&lt;b a=&quot;&#39;&amp;\u{fffd}",
            "HTML"
        );
        assert_eq!(inside_script("</script>"), "\\u003c/script>", "JSON");
        assert_eq!(csv_field("a,\"b\""), "\"a,\"\"b\"\"\"", "CSV");
        assert_eq!(csv_field("plain"), "plain", "CSV");
        assert_eq!(slug(" L4 left: 3 mm!"), "l4-left-3-mm", "file name");
    }
}
