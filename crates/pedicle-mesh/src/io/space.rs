//! Which way the axes of a patient's coordinates point.
//!
//! ```text
//! x_LPS = diag(-1, -1, 1) x_RAS
//! ```
//!
//! 3D Slicer keeps points as RAS (right, anterior, superior) and writes most files as LPS (left,
//! posterior, superior). Its meshes say which in a comment `SPACE=RAS` or `SPACE=LPS`.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion};

/// A patient's coordinate system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Space {
    /// x to the right, y to the front, z to the head.
    #[default]
    Ras,
    /// x to the left, y to the back, z to the head.
    Lps,
}

impl Space {
    /// The space called `name` ("RAS" or "LPS", any case).
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name.trim().to_ascii_uppercase().as_str() {
            "RAS" => Some(Self::Ras),
            "LPS" => Some(Self::Lps),
            _ => None,
        }
    }

    /// The name: "RAS" or "LPS".
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ras => "RAS",
            Self::Lps => "LPS",
        }
    }

    /// The other one.
    #[must_use]
    pub fn opposite(self) -> Self {
        match self {
            Self::Ras => Self::Lps,
            Self::Lps => Self::Ras,
        }
    }

    /// The motion from this space to another: none, or half a turn about z.
    #[must_use]
    pub fn motion_to(self, other: Self) -> Isometry3<f64> {
        if self == other {
            return Isometry3::identity();
        }
        let half_turn = Matrix3::from_diagonal(&nalgebra::Vector3::new(-1.0, -1.0, 1.0));
        let rotation = Rotation3::from_matrix_unchecked(half_turn);
        let quaternion = UnitQuaternion::from_rotation_matrix(&rotation);
        Isometry3::from_parts(Translation3::identity(), quaternion)
    }

    /// A point of this space in another; exact, as only signs change.
    #[must_use]
    pub fn point_to(self, other: Self, p: &Point3<f64>) -> Point3<f64> {
        if self == other {
            return *p;
        }
        // Adding zero keeps -0.0 out of files.
        Point3::new(-p.x + 0.0, -p.y + 0.0, p.z)
    }
}

impl std::fmt::Display for Space {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl std::str::FromStr for Space {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::from_name(name).ok_or_else(|| format!("'{name}' is neither RAS nor LPS"))
    }
}

/// The space that comments of a mesh file name as `SPACE=RAS` or `SPACE=LPS`.
#[must_use]
pub fn space_of(comments: &[String]) -> Option<Space> {
    comments.iter().find_map(|comment| {
        let (_, name) = comment.split_once("SPACE=")?;
        let end = name
            .find(|c: char| !c.is_ascii_alphabetic())
            .unwrap_or(name.len());
        Space::from_name(&name[..end])
    })
}
