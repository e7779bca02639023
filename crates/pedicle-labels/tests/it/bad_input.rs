//! What must be refused, and with which words.

use pedicle_labels::LabelError;

use crate::support::{Nifti, gzip, refused};

fn holds(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "no '{word}' in: {text}");
    }
}

#[test]
fn labels_that_are_no_lumbar_ones() {
    let mut file = Nifti::plain();
    file.labels
        .iter_mut()
        .filter(|l| **l > 0)
        .for_each(|l| *l -= 19);
    let (error, text) = refused(&file.gz());
    assert!(
        matches!(error, LabelError::NoLumbarLabels { .. }),
        "{error:?}"
    );
    holds(&text, &["1 to 5", "verse", "20 to 24", "27 to 31"]);
    file.labels.fill(0);
    holds(&refused(&file.gz()).1, &["none"]);
}

#[test]
fn two_spines() {
    let one = Nifti::plain();
    let [ni, nj, nk] = one.size;
    let mut two = one.clone();
    two.size = [2 * ni, nj, nk];
    let rows = one.labels.chunks_exact(ni);
    two.labels = rows.flat_map(|row| [row, row].concat()).collect();
    let (error, text) = refused(&two.gz());
    assert!(
        matches!(error, LabelError::TwoParts { label: 20, .. }),
        "{error:?}"
    );
    holds(&text, &["L1", "two large parts", "cm³"]);
}

#[test]
fn a_level_cut_by_the_field_of_view() {
    let mut file = Nifti::plain();
    let slice = file.size[0] * file.size[1];
    // L5 lies at k = 10 to 30: cut through its middle.
    file.labels.drain(..20 * slice);
    file.size[2] -= 20;
    let (error, text) = refused(&file.gz());
    assert!(
        matches!(error, LabelError::CutByFieldOfView { label: 24, .. }),
        "{error:?}"
    );
    holds(&text, &["L5", "first k", "mm²"]);
}

#[test]
fn float_labels_even_whole_ones() {
    for (datatype, name) in [(16, "float32"), (64, "float64")] {
        let file = Nifti {
            datatype,
            ..Nifti::plain()
        };
        let (error, text) = refused(&file.gz());
        assert!(matches!(error, LabelError::NotInteger { .. }), "{error:?}");
        holds(&text, &[name, "integer"]);
    }
}

#[test]
fn fractional_labels_after_scaling() {
    let mut file = Nifti::plain();
    file.slope_inter = (0.3, 0.0);
    let (error, text) = refused(&file.bytes());
    assert!(
        matches!(error, LabelError::FractionalLabel { .. }),
        "{error:?}"
    );
    holds(&text, &["scl_slope", "0.3"]);
}

#[test]
fn broken_headers() {
    let good = Nifti::plain().bytes();
    let with = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    let nan = f32::NAN.to_le_bytes();
    let cases: [(&str, Vec<u8>, &[&str]); 11] = [
        (
            "no NIfTI",
            b"this is no NIfTI file, but long enough to be one?".repeat(20),
            &["sizeof_hdr"],
        ),
        ("nothing", Vec::new(), &["0 bytes"]),
        ("half a header", good[..200].to_vec(), &["200 bytes", "348"]),
        ("magic", with(344, b"abc\0"), &["magic", "abc"]),
        ("two files", with(344, b"ni1\0"), &[".hdr and .img"]),
        (
            "negative size",
            with(42, &(-5_i16).to_le_bytes()),
            &["dim[1] is -5"],
        ),
        ("axes", with(40, &9_i16.to_le_bytes()), &["dim[0] is 9"]),
        (
            "volumes",
            with(40, &[4, 0, 70, 0, 50, 0, 150, 0, 3, 0]),
            &["dim[4] is 3"],
        ),
        ("bitpix", with(72, &16_i16.to_le_bytes()), &["bitpix is 16"]),
        ("offset", with(108, &nan), &["vox_offset is NaN"]),
        ("unit", with(123, &[7]), &["unit of length 7"]),
    ];
    for (what, bytes, words) in cases {
        let (error, text) = refused(&bytes);
        assert!(
            matches!(error, LabelError::Header { .. }),
            "{what}: {error:?}"
        );
        holds(&text, words);
    }
    let (error, _) = refused(&with(254, &[0, 0]));
    assert!(
        matches!(error, LabelError::NoOrientation { .. }),
        "{error:?}"
    );
    for bytes in [&nan[..], &[0; 4]] {
        let (error, _) = refused(&with(280, bytes));
        assert!(
            matches!(error, LabelError::SingularAffine { .. }),
            "{error:?}"
        );
    }
    let (error, text) = refused(&with(70, &77_i16.to_le_bytes()));
    assert!(matches!(error, LabelError::NotInteger { .. }), "{error:?}");
    holds(&text, &["77"]);
}

#[test]
fn truncated_and_damaged_files() {
    let file = Nifti::plain();
    let (error, text) = refused(&file.bytes()[..100_000]);
    assert!(matches!(error, LabelError::CutOff { .. }), "{error:?}");
    holds(&text, &["525000", "99648"]);
    let gz = file.gz();
    for length in [5, 100, gz.len() / 2, gz.len() - 4] {
        let (error, text) = refused(&gz[..length]);
        assert!(
            matches!(error, LabelError::Gzip { .. }),
            "{length}: {error:?}"
        );
        holds(&text, &["gzip stream is damaged"]);
    }
    let mut damaged = gz.clone();
    let checksum = gz.len() - 6;
    damaged[checksum] ^= 0x55;
    assert!(
        matches!(refused(&damaged).0, LabelError::Gzip { .. }),
        "the checksum is read"
    );
    // Any damage gives an error or a spine, but no panic.
    for at in (0..gz.len()).step_by(gz.len() / 40) {
        let mut damaged = gz.clone();
        damaged[at] ^= 0x10;
        let _any = crate::support::import_bytes("labels.nii.gz", &damaged);
    }
}

#[test]
fn a_stream_longer_than_announced_is_not_read_to_its_end() {
    let mut bytes = Nifti::plain().bytes();
    bytes.resize(bytes.len() + (64 << 20), 0);
    let (error, text) = refused(&gzip(&bytes));
    assert!(matches!(error, LabelError::TooLong { .. }), "{error:?}");
    holds(&text, &["525000"]);
}

#[test]
fn headers_that_announce_too_much() {
    let mut file = Nifti::plain();
    file.labels.clear();
    file.size = [32_000, 32_000, 32_000];
    assert!(
        matches!(refused(&file.gz()).0, LabelError::TooLarge { .. }),
        "32 TB"
    );
    file.version = 2;
    file.size = [1 << 30, 1, 1];
    assert!(
        matches!(refused(&file.gz()).0, LabelError::TooLarge { .. }),
        "one endless row"
    );
    file.size = [usize::MAX >> 1; 3];
    assert!(
        matches!(refused(&file.gz()).0, LabelError::TooLarge { .. }),
        "overflow"
    );
    // Announced and within the bounds, but not there: nothing is allocated for it.
    file.size = [1200, 1200, 1200];
    assert!(
        matches!(refused(&file.gz()).0, LabelError::CutOff { .. }),
        "1.7 GB of nothing"
    );
}

#[test]
fn images_are_no_label_maps() {
    let mut file = Nifti::plain();
    file.datatype = 4;
    for (index, label) in file.labels.iter_mut().enumerate() {
        *label = (index * 7919 % 30_000) as i64 - 15_000;
    }
    let (error, text) = refused(&file.gz());
    assert!(matches!(error, LabelError::NotLabels { .. }), "{error:?}");
    holds(&text, &["4096 different labels"]);
}
