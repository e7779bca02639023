//! Which label is which level.

use pedicle_labels::{ImportOptions, LabelError, LabelScheme, SchemeChoice, import_label_map};

use crate::support::{Folder, Nifti, VERSE, grid, import_bytes};

const TOTALSEGMENTATOR: [i64; 5] = [31, 30, 29, 28, 27];

fn spine(labels: [i64; 5]) -> Nifti {
    Nifti::spine(grid([1.0; 3]), [70, 50, 150], labels)
}

#[test]
fn known_schemes_are_told_apart() {
    let total = import_bytes("a.nii", &spine(TOTALSEGMENTATOR).bytes()).unwrap();
    assert_eq!(total.scheme.name, "totalsegmentator", "from the labels");
    let verse = import_bytes("a.nii", &spine(VERSE).bytes()).unwrap();
    assert_eq!(verse.scheme.name, "verse", "from the labels");
    for (a, b) in total.levels.iter().zip(&verse.levels) {
        assert_eq!((a.level, &a.mesh), (b.level, &b.mesh), "the same spine");
    }
}

#[test]
fn levels_that_are_not_there_are_named() {
    let mut file = spine(VERSE);
    file.labels
        .iter_mut()
        .filter(|l| **l == 20)
        .for_each(|l| *l = 0);
    let found = import_bytes("a.nii", &file.bytes()).unwrap();
    let missing: Vec<&str> = found.missing.iter().map(|l| l.name()).collect();
    assert_eq!(
        (missing, found.levels.len()),
        (vec!["L1"], 4),
        "four of five"
    );
}

fn import_with(scheme: LabelScheme, file: &Nifti) -> Result<usize, LabelError> {
    let folder = Folder::new();
    let path = folder.file("labels.nii", &file.bytes());
    let options = ImportOptions {
        scheme: SchemeChoice::Scheme(scheme),
        ..ImportOptions::default()
    };
    import_label_map(path, &options, &mut |_| {}).map(|spine| spine.levels.len())
}

#[test]
fn the_wrong_scheme_is_refused_with_the_labels_and_the_right_one() {
    let error = import_with(LabelScheme::verse(), &spine(TOTALSEGMENTATOR)).unwrap_err();
    assert!(
        matches!(error, LabelError::NoLumbarLabels { .. }),
        "{error:?}"
    );
    let text = error.to_string();
    for word in ["verse", "20 to 24", "27 to 31", "totalsegmentator"] {
        assert!(text.contains(word), "no '{word}' in: {text}");
    }
    // Both sets of labels: nobody can know.
    let mut both = spine(VERSE);
    both.add(
        grid([1.0; 3]),
        nalgebra::Point3::new(30.0, 20.0, 0.0),
        [3.0; 3],
        28,
    );
    for (label, index) in TOTALSEGMENTATOR.iter().zip(0..) {
        both.labels[index] = *label;
    }
    let error = import_bytes("a.nii", &both.bytes()).unwrap_err();
    assert!(
        matches!(error, LabelError::AmbiguousScheme { .. }),
        "{error:?}"
    );
    assert_eq!(
        import_with(LabelScheme::verse(), &both).unwrap(),
        5,
        "once it is said"
    );
    // Counted the wrong way round.
    let error = import_with(LabelScheme::verse(), &spine([24, 23, 22, 21, 20])).unwrap_err();
    assert!(matches!(error, LabelError::NotASpine { .. }), "{error:?}");
}

#[test]
fn schemes_from_files() {
    let folder = Folder::new();
    let read = |text: &str| LabelScheme::read(&folder.file("scheme.ron", text.as_bytes()));
    let own = read("(name: \"ours\", levels: {L1: 5, L2: 4, L3: 3, L4: 2, L5: -1})").unwrap();
    let mut file = spine([5, 4, 3, 2, -1]);
    file.datatype = 4;
    assert_eq!(
        import_with(own, &file).unwrap(),
        5,
        "any labels, also negative ones"
    );
    for (text, word) in [
        ("(name: \"x\", levels: {})", "no level"),
        ("(name: \"x\", levels: {L1: 0})", "background"),
        ("(name: \"x\", levels: {L1: 3, L2: 3})", "same label 3"),
        ("(name: \"x\", levels: {L9: 3})", "L9"),
        ("(name: \"x\"", "scheme.ron"),
    ] {
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains(word), "no '{word}' in: {error}");
    }
}
