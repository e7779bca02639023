//! `cargo xtask scaling` on the smallest sizes.

use std::process::Command;

#[test]
fn two_sizes_give_tables_and_exponents() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scaling.md");
    let output = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["scaling", "--max", "2000", "--threads", "2", "--output"])
        .arg(&file)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let text = std::fs::read_to_string(file).unwrap();
    for words in [
        "1026 | ",
        "1938 | ",
        "| operators ",
        "| 100 eigenpairs ",
        "| ZoomOut 20 → 100 by 5 ",
        "| BCICP ",
        "exponent |",
        "## Peak memory",
    ] {
        assert!(text.contains(words), "no '{words}' in\n{text}");
    }
    assert_eq!(
        said.lines().count(),
        12,
        "one line a stage and size: {said}"
    );
}
