//! Point clouds as text: three numbers a line.

use std::path::Path;

use nalgebra::Point3;

use crate::Error;

/// Extensions of files that are read as clouds.
const EXTENSIONS: [&str; 4] = ["xyz", "csv", "txt", "pts"];

/// Whether a file is a point cloud by its extension: `.xyz`, `.csv`, `.txt` or `.pts`.
#[must_use]
pub fn is_cloud_file(path: impl AsRef<Path>) -> bool {
    let extension = path.as_ref().extension().unwrap_or_default();
    EXTENSIONS
        .iter()
        .any(|known| extension.eq_ignore_ascii_case(known))
}

/// Reads the points of a text file, mm.
///
/// A line begins with x, y and z, separated by spaces, tabs, commas or semicolons; what follows them is
/// skipped. Blank lines and lines that begin with `#` or `//` are skipped too, and so is a first line
/// of words or a single count.
///
/// # Errors
/// [`Error`] if the file cannot be read, a line has fewer than three numbers, or one is not finite.
pub fn read_cloud(path: impl AsRef<Path>) -> Result<Vec<Point3<f64>>, Error> {
    let path = path.as_ref();
    let text = std::fs::read_to_string(path).map_err(|source| Error::ReadCloud {
        path: path.to_owned(),
        source,
    })?;
    let mut points = Vec::new();
    let mut is_first = true;
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') || line.starts_with("//") {
            continue;
        }
        let is_header = std::mem::take(&mut is_first) && is_header(line);
        if is_header {
            continue;
        }
        let point = point_of(line).map_err(|message| Error::CloudLine {
            path: path.to_owned(),
            line: index + 1,
            message,
        })?;
        points.push(point);
    }
    Ok(points)
}

fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| c.is_whitespace() || c == ',' || c == ';')
        .filter(|field| !field.is_empty())
}

/// Names of columns, or how many points follow.
fn is_header(line: &str) -> bool {
    let first = fields(line).next();
    first.is_some_and(|field| field.parse::<f64>().is_err()) || fields(line).count() == 1
}

fn point_of(line: &str) -> Result<Point3<f64>, String> {
    let mut point = Point3::origin();
    let mut given = fields(line);
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let Some(field) = given.next() else {
            return Err(format!("{axis} numbers, three needed"));
        };
        let number = field.parse::<f64>().ok().filter(|x| x.is_finite());
        point[axis] = number.ok_or_else(|| format!("{name} is {field:?}, no finite number"))?;
    }
    Ok(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Point3<f64>>, Error> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scan.xyz");
        std::fs::write(&path, text).unwrap();
        read_cloud(path)
    }

    #[test]
    fn separators_headers_comments_and_further_columns_are_understood() {
        let points = [Point3::new(1.0, -2.5, 3e2), Point3::new(0.0, 4.0, 5.0)];
        for text in [
            "1 -2.5 3e2\n0\t4  5\n",
            "x,y,z,intensity\n1,-2.5,300,17\n0, 4, 5, 18\n",
            "# a scan\n2\n1;-2.5;300\n\n// end\n0;4;5\r\n",
        ] {
            assert_eq!(read(text).unwrap(), points, "{text:?}");
        }
        assert_eq!(read("").unwrap(), vec![], "an empty file");
    }

    #[test]
    fn a_bad_line_is_named() {
        for (text, words) in [
            ("1 2 3\n4 5\n", "line 2: 2 numbers, three needed"),
            ("1 2 3\n4 five 6\n", "line 2: y is \"five\""),
            ("1 2 NaN\n", "line 1: z is \"NaN\""),
            ("x y z\nx y z\n", "line 2: x is \"x\""),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(
                error.contains(words) && error.contains("scan.xyz"),
                "{error}"
            );
        }
        assert!(read_cloud("nowhere.xyz").is_err(), "there is no such file");
    }

    #[test]
    fn clouds_are_known_by_their_extension() {
        assert!(is_cloud_file("a.XYZ") && is_cloud_file("b.csv"), "text");
        assert!(!is_cloud_file("a.ply") && !is_cloud_file("xyz"), "others");
    }
}
