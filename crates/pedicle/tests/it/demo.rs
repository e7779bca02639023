//! `pedicle demo` and the files it saves.

use std::process::Command;

use crate::support::{pedicle, stderr};

#[test]
fn the_demo_works_and_its_files_are_a_transfer() {
    let folder = tempfile::tempdir().unwrap();
    let save = folder.path().join("demo");
    let output = pedicle(&["demo", "--save", save.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    for word in ["L1", "L5", "accepted", "Compared with the truth"] {
        assert!(printed.contains(word), "no '{word}' in\n{printed}");
    }

    let again = Command::new(env!("CARGO_BIN_EXE_pedicle"))
        .current_dir(&save)
        .args([
            "transfer",
            "--source",
            "source",
            "--plan",
            "plan.ron",
            "--target",
            "target.ply",
        ])
        .args(["--source-landmarks", "source-landmarks.ron"])
        .args([
            "--target-landmarks",
            "target-landmarks.ron",
            "--json",
            "result.json",
        ])
        .output()
        .unwrap();
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    assert!(save.join("result.json").is_file(), "the result is written");
}

#[test]
fn help_has_examples_and_wrong_usage_is_exit_code_2() {
    let help = pedicle(&["--help"]);
    assert_eq!(help.status.code(), Some(0), "{}", stderr(&help));
    assert!(
        String::from_utf8_lossy(&help.stdout).contains("Examples:"),
        "examples in the help"
    );
    for arguments in [
        &["frobnicate"][..],
        &["transfer"][..],
        &["demo", "--seed", "x"][..],
    ] {
        let output = pedicle(arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            stderr(&output)
        );
    }
}
