//! Pairs of vertices that correspond, from a file.
//!
//! ```text
//! # source target, counted from 0
//! 12  40
//! 833, 901
//! ```
//!
//! A text file has one pair a line, separated by blanks, tabs or a comma; what follows a `#` is a
//! comment. A file with the extension `.json` holds a list of pairs, `[[12, 40], [833, 901]]`,
//! with one pair a line or not.

use std::path::{Path, PathBuf};

/// A vertex of the source and the vertex of the target that corresponds to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VertexPair {
    /// Vertex of the source, counted from 0.
    pub source: usize,
    /// Vertex of the target, counted from 0.
    pub target: usize,
}

/// Why a file of vertex pairs was refused. Every text is one sentence with the file and the place.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VertexPairError {
    /// The operating system refused.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Something that is no pair of vertices.
    #[error("{}, line {line}: {message}", path.display())]
    NotAPair {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A vertex that the mesh does not have.
    #[error(
        "{}, {place}: vertex {vertex} of the {shape} is named, but it has only {n_vertices} \
         (counted from 0)",
        path.display()
    )]
    OutOfRange {
        /// The file.
        path: PathBuf,
        /// `line 3` of a text, `pair 2` of a JSON list.
        place: String,
        /// `source` or `target`.
        shape: &'static str,
        /// The vertex.
        vertex: usize,
        /// Number of vertices.
        n_vertices: usize,
    },
    /// A vertex with two partners.
    #[error("{}, {place}: vertex {vertex} of the {shape} has a partner already", path.display())]
    Doubled {
        /// The file.
        path: PathBuf,
        /// `line 3` of a text, `pair 2` of a JSON list.
        place: String,
        /// `source` or `target`.
        shape: &'static str,
        /// The vertex.
        vertex: usize,
    },
    /// No pair at all.
    #[error("{}: the file holds no pair of vertices", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// A pair and where it was found.
type Placed = (String, VertexPair);

/// Reads pairs of vertices of a source with `n_source` and a target with `n_target` vertices.
///
/// # Errors
/// [`VertexPairError`] if the file cannot be read, a line is no pair, a vertex does not exist or
/// has two partners, or there is no pair.
pub fn read_vertex_pairs(
    path: &Path,
    n_source: usize,
    n_target: usize,
) -> Result<Vec<VertexPair>, VertexPairError> {
    let text = std::fs::read_to_string(path).map_err(|source| VertexPairError::Io {
        path: path.to_owned(),
        source,
    })?;
    let is_json = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let pairs = if is_json {
        parse_json(path, &text)?
    } else {
        parse_text(path, &text)?
    };
    if pairs.is_empty() {
        return Err(VertexPairError::Empty {
            path: path.to_owned(),
        });
    }
    check(path, &pairs, "source", n_source, |pair| pair.source)?;
    check(path, &pairs, "target", n_target, |pair| pair.target)?;
    Ok(pairs.into_iter().map(|(_, pair)| pair).collect())
}

fn parse_text(path: &Path, text: &str) -> Result<Vec<Placed>, VertexPairError> {
    let mut pairs = Vec::new();
    for (line, content) in (1..).zip(text.lines()) {
        let refused = |message: String| VertexPairError::NotAPair {
            path: path.to_owned(),
            line,
            message,
        };
        let data = content.split('#').next().unwrap_or_default();
        let words: Vec<&str> = data
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|word| !word.is_empty())
            .collect();
        if words.is_empty() {
            continue;
        }
        let vertices = words
            .iter()
            .map(|word| {
                word.parse::<usize>().map_err(|_| {
                    refused(format!("{word:?} is no vertex, a whole number from 0 on"))
                })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let [source, target] = vertices[..] else {
            let n = vertices.len();
            return Err(refused(format!(
                "a vertex of the source and one of the target are needed, here are {n} numbers"
            )));
        };
        pairs.push((format!("line {line}"), VertexPair { source, target }));
    }
    Ok(pairs)
}

fn parse_json(path: &Path, text: &str) -> Result<Vec<Placed>, VertexPairError> {
    let pairs: Vec<[usize; 2]> =
        serde_json::from_str(text).map_err(|error| VertexPairError::NotAPair {
            path: path.to_owned(),
            line: error.line(),
            message: format!("no list of pairs such as [[0, 7], [1, 9]]: {error}"),
        })?;
    Ok((1..)
        .zip(pairs)
        .map(|(index, [source, target])| (format!("pair {index}"), VertexPair { source, target }))
        .collect())
}

fn check(
    path: &Path,
    pairs: &[Placed],
    shape: &'static str,
    n_vertices: usize,
    vertex_of: impl Fn(&VertexPair) -> usize,
) -> Result<(), VertexPairError> {
    let mut seen = std::collections::BTreeSet::new();
    for (place, pair) in pairs {
        let vertex = vertex_of(pair);
        let (path, place) = (path.to_owned(), place.clone());
        if vertex >= n_vertices {
            return Err(VertexPairError::OutOfRange {
                path,
                place,
                shape,
                vertex,
                n_vertices,
            });
        }
        if !seen.insert(vertex) {
            return Err(VertexPairError::Doubled {
                path,
                place,
                shape,
                vertex,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<Vec<VertexPair>, VertexPairError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read_vertex_pairs(&path, 10, 20)
    }

    #[test]
    fn text_and_json_say_the_same() {
        let text = "# source target\n\n3 17\n 9,\t0 # the tail\n";
        let expected = [(3, 17), (9, 0)].map(|(source, target)| VertexPair { source, target });
        assert_eq!(read("pairs.txt", text).unwrap(), expected, "text");
        let json = "[[3, 17],\n [9, 0]]";
        assert_eq!(read("pairs.JSON", json).unwrap(), expected, "JSON");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        for (name, text, words) in [
            ("a.txt", "0 1\n2\n", vec!["a.txt, line 2", "1 numbers"]),
            ("a.txt", "0 1\n\n2 x\n", vec!["line 3", "\"x\""]),
            ("a.txt", "-1 1\n", vec!["line 1", "\"-1\""]),
            (
                "a.txt",
                "0 1\n10 2\n",
                vec!["line 2", "vertex 10 of the source", "only 10"],
            ),
            (
                "a.txt",
                "0 20\n",
                vec!["line 1", "vertex 20 of the target", "only 20"],
            ),
            (
                "a.txt",
                "0 1\n0 2\n",
                vec!["line 2", "vertex 0 of the source", "already"],
            ),
            (
                "a.txt",
                "0 1\n3 1\n",
                vec!["line 2", "vertex 1 of the target", "already"],
            ),
            ("a.txt", "# nothing\n", vec!["a.txt", "no pair"]),
            ("a.json", "[[0, 1],\n[2]]", vec!["a.json, line 2"]),
            (
                "a.json",
                "[[0, 1], [2, 99]]",
                vec!["pair 2", "vertex 99 of the target"],
            ),
        ] {
            let message = read(name, text).unwrap_err().to_string();
            for word in words {
                assert!(message.contains(word), "no '{word}' in: {message}");
            }
        }
    }
}
