//! Writes a phantom as one OBJ file a vertebra: `phantom_obj DIRECTORY [SUBJECT]`.

use std::error::Error;
use std::fmt::Write as _;

use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let directory = arguments
        .next()
        .ok_or("usage: phantom_obj DIRECTORY [SUBJECT]")?;
    let parameters = match arguments.next() {
        Some(seed) => PhantomParameters::subject(seed.parse()?),
        None => PhantomParameters::default(),
    };
    std::fs::create_dir_all(&directory)?;
    let phantom = generate_phantom(&parameters, &MeshingOptions::default())?;
    for vertebra in &phantom.vertebrae {
        let mut text = String::new();
        for p in vertebra.mesh.vertices() {
            writeln!(text, "v {} {} {}", p.x, p.y, p.z)?;
        }
        for [a, b, c] in vertebra.mesh.faces() {
            writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1)?;
        }
        std::fs::write(format!("{directory}/{}.obj", vertebra.level), text)?;
    }
    Ok(())
}
