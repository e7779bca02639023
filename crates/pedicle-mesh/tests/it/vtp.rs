//! VTP, and the space that a mesh file names.

use pedicle_mesh::{Encoding, ReadError, Space, WriteOptions, read_mesh, space_of, write_mesh};

use crate::io::{file, folder, message, read};
use crate::shapes::icosphere;

#[test]
fn what_is_written_is_read_again_bit_by_bit() {
    let folder = folder();
    let mesh = icosphere(3);
    let path = folder.path().join("sphere.vtp");
    let options = WriteOptions {
        comments: vec!["SPACE=LPS".to_owned(), "a -- b".to_owned()],
        ..WriteOptions::default()
    };
    write_mesh(&path, &mesh, &options).unwrap();
    let found = read_mesh(&path).unwrap();
    assert_eq!(found.mesh, mesh, "f64 and indices");
    assert_eq!(found.comments, ["SPACE=LPS"], "the field");
}

#[test]
fn every_format_tells_its_space() {
    let folder = folder();
    let mesh = icosphere(1);
    for space in [Space::Ras, Space::Lps] {
        for name in ["a.ply", "a.stl", "a.obj", "a.off", "a.vtp"] {
            for encoding in [Encoding::Ascii, Encoding::Binary] {
                let path = folder.path().join(name);
                let comments = vec![format!("written by a test. SPACE={space}; mm")];
                let options = WriteOptions {
                    comments,
                    encoding,
                    ..WriteOptions::default()
                };
                write_mesh(&path, &mesh, &options).unwrap();
                let found = read_mesh(&path).unwrap();
                assert_eq!(
                    space_of(&found.comments),
                    Some(space),
                    "{name} {encoding:?}"
                );
                assert_eq!(found.mesh.n_faces(), mesh.n_faces(), "{name} {encoding:?}");
            }
        }
    }
    assert_eq!(space_of(&["SPACE=XYZ".to_owned()]), None, "unknown");
    assert_eq!(space_of(&["space".to_owned()]), None, "nothing said");
}

const HEAD: &str =
    "<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\"><PolyData>";
const POINTS: &str = "<Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">\
    0 0 0 1 0 0 1 1 0 0 1 0</DataArray></Points>";

fn ascii(points: &str, connectivity: &str, offsets: &str) -> String {
    format!(
        "{HEAD}<Piece NumberOfPoints=\"4\" NumberOfPolys=\"1\">{points}<Polys>\
         <DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">{connectivity}</DataArray>\
         <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">{offsets}</DataArray></Polys></Piece>\
         </PolyData></VTKFile>"
    )
}

#[test]
fn polygons_become_fans_and_pieces_are_joined() {
    let square = read("a.vtp", ascii(POINTS, "0 1 2 3", "4")).unwrap().mesh;
    assert_eq!(square.faces(), [[0, 1, 2], [0, 2, 3]], "a fan");
    let text = ascii(POINTS, "0 1 2", "3");
    let (start, rest) = text.split_once("<Piece").unwrap();
    let (piece, end) = rest.split_once("</Piece>").unwrap();
    let two = format!("{start}<Piece{piece}</Piece><Piece{piece}</Piece>{end}");
    let found = read("a.vtp", two).unwrap().mesh;
    assert_eq!(
        (found.n_vertices(), found.faces()),
        (8, &[[0, 1, 2], [4, 5, 6]][..]),
        "two pieces"
    );
}

#[test]
fn broken_files_are_refused_with_the_place() {
    let good = ascii(POINTS, "0 1 2 3", "4");
    let swap = |from: &str, to: &str| good.replace(from, to);
    let cases = [
        ("this is no XML".to_owned(), "XML"),
        (good[..200].to_owned(), "XML"),
        (
            swap("PolyData\" version", "ImageData\" version"),
            "PolyData",
        ),
        (
            swap("NumberOfPoints=\"4\"", "NumberOfPoints=\"5\""),
            "announces 5",
        ),
        (
            swap("NumberOfPoints=\"4\"", "NumberOfPoints=\"many\""),
            "many",
        ),
        (
            swap("NumberOfPolys=\"1\"", "NumberOfPolys=\"2\""),
            "announces 2",
        ),
        (swap("0 1 2 3<", "0 1 2 9<"), "vertex 9"),
        (swap(">4<", ">40<"), "offset 40"),
        (swap("1 1 0 0", "1 NaN 0 0"), "not finite"),
        (swap("1 1 0 0", "1 x 0 0"), "not a number"),
        (
            swap(
                "byte_order=\"LittleEndian\"",
                "compressor=\"vtkLZ4DataCompressor\"",
            ),
            "vtkLZ4DataCompressor",
        ),
        (
            swap("format=\"ascii\">0 1", "format=\"binary\">0 1"),
            "connectivity",
        ),
        (
            swap(
                "format=\"ascii\">0 1",
                "format=\"appended\" offset=\"7\">0 1",
            ),
            "AppendedData",
        ),
        (
            swap("NumberOfPolys", "NumberOfStrips=\"3\" NumberOfPolys"),
            "strips",
        ),
    ];
    for (text, word) in cases {
        let found = message("bad.vtp", &text);
        assert!(found.contains(word), "no '{word}' in: {found}");
    }
}

#[test]
fn sizes_that_lie_do_not_allocate() {
    // A block of 2^60 bytes, and 2^60 blocks.
    for (header, compressor) in [
        ("AAAAAAAAABA=", ""),
        ("AAAAAAAAABA=", "compressor=\"vtkZLibDataCompressor\" "),
    ] {
        let text = ascii(POINTS, header, "4")
            .replace(
                "<VTKFile ",
                &format!("<VTKFile {compressor}header_type=\"UInt64\" "),
            )
            .replace("format=\"ascii\">AAAA", "format=\"binary\">AAAA");
        let found = message("bad.vtp", &text);
        assert!(found.contains("connectivity"), "{found}");
    }
}

#[test]
fn damaged_files_never_panic() {
    let folder = folder();
    let path = folder.path().join("sphere.vtp");
    write_mesh(&path, &icosphere(1), &WriteOptions::default()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for at in (0..bytes.len()).step_by(bytes.len() / 60) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x15;
        let result: Result<_, ReadError> = read_mesh(file(&folder, "damaged.vtp", damaged));
        let _any = result;
        let _any = read_mesh(file(&folder, "cut.vtp", &bytes[..at]));
    }
}
