//! The sizes of C that ZoomOut passes through.

use crate::{
    FmapError, FunctionalMap, Shape, Side,
    convert::{check_basis, check_map},
    map::check_size,
};

/// From the size of the first map to that of the last.
pub(crate) struct Growth {
    /// (n_target, n_source) of the first map.
    start: (usize, usize),
    end: (usize, usize),
    step: usize,
    /// Steps after the first map.
    pub(crate) n_steps: usize,
}

impl Growth {
    /// Checks both shapes, the map and the sizes; `end` is (n_target, n_source).
    pub(crate) fn new(
        (source, target): (&Shape<'_>, &Shape<'_>),
        map: &FunctionalMap,
        end: (usize, usize),
        step: usize,
    ) -> Result<Self, FmapError> {
        for (what, shape) in [
            ("vertices of the source basis", source),
            ("vertices of the target basis", target),
        ] {
            check_size(what, shape.basis.n_vertices(), shape.mesh.n_vertices())?;
        }
        check_map(source.basis, target.basis, map)?;
        check_basis(source.basis, Side::Source, end.1)?;
        check_basis(target.basis, Side::Target, end.0)?;
        at_least_one("step", step)?;
        let start = (map.n_target(), map.n_source());
        for (option, first, last) in [("n_source", start.1, end.1), ("n_target", start.0, end.0)] {
            if last < first {
                return Err(FmapError::InvalidOption {
                    option,
                    value: last as f64,
                    requirement: "it must not be below that of the map to be refined",
                });
            }
        }
        let steps_of_source = (end.1 - start.1).div_ceil(step);
        Ok(Self {
            start,
            end,
            step,
            n_steps: steps_of_source.max((end.0 - start.0).min(1)),
        })
    }

    /// (n_target, n_source) after some steps: the source grows by `step`, the target in
    /// proportion, both are exact at the end.
    pub(crate) fn size(&self, step: usize) -> (usize, usize) {
        if step >= self.n_steps {
            return self.end;
        }
        let n_source = (self.start.1 + step * self.step).min(self.end.1);
        let n_target = self.start.0 + (self.end.0 - self.start.0) * step / self.n_steps;
        (n_target, n_source)
    }
}

pub(crate) fn at_least_one(option: &'static str, value: usize) -> Result<(), FmapError> {
    if value == 0 {
        return Err(FmapError::InvalidOption {
            option,
            value: 0.0,
            requirement: "it must be at least 1",
        });
    }
    Ok(())
}
