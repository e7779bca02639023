//! How names and points are written in files.
//!
//! A level or side is a bare word in RON (`level: L4`) and a string in JSON (`"level": "L4"`).
//! A point is three numbers, in round or square brackets.

use std::fmt;
use std::marker::PhantomData;
use std::str::FromStr;

use serde::Deserializer;
use serde::de::{DeserializeSeed, EnumAccess, Error, VariantAccess, Visitor};

/// A name that is none of the known ones.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown {what} \"{name}\", expected one of {}", known.join(", "))]
pub struct UnknownName {
    /// What the name should be: "level" or "side".
    pub what: &'static str,
    /// The name given.
    pub name: String,
    /// The names there are.
    pub known: &'static [&'static str],
}

impl UnknownName {
    pub(crate) fn new(
        what: &'static str,
        name: &str,
        known: &'static [&'static str],
    ) -> UnknownName {
        let name = name.to_owned();
        UnknownName { what, name, known }
    }
}

/// Reads a unit variant by its name, in the way of the format at hand.
pub(crate) fn deserialize_name<'de, D, T>(
    deserializer: D,
    type_name: &'static str,
    names: &'static [&'static str],
) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr<Err = UnknownName>,
{
    deserializer.deserialize_enum(type_name, names, NameVisitor(names, PhantomData))
}

struct NameVisitor<T>(&'static [&'static str], PhantomData<T>);

impl<T> NameVisitor<T> {
    fn again(&self) -> Self {
        Self(self.0, PhantomData)
    }
}

impl<'de, T: FromStr<Err = UnknownName>> Visitor<'de> for NameVisitor<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "one of {}", self.0.join(", "))
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<T, E> {
        name.parse().map_err(E::custom)
    }

    fn visit_enum<A: EnumAccess<'de>>(self, access: A) -> Result<T, A::Error> {
        let (value, variant) = access.variant_seed(self.again())?;
        variant.unit_variant()?;
        Ok(value)
    }
}

impl<'de, T: FromStr<Err = UnknownName>> DeserializeSeed<'de> for NameVisitor<T> {
    type Value = T;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<T, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

/// Three numbers as a point.
pub(crate) mod point {
    use std::fmt;

    use nalgebra::Point3;
    use serde::de::{Error, SeqAccess, Visitor};
    use serde::{Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(p: &Point3<f64>, s: S) -> Result<S::Ok, S::Error> {
        (p.x, p.y, p.z).serialize(s)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Point3<f64>, D::Error> {
        // Either kind of bracket is natural in RON, so the text decides.
        d.deserialize_any(PointVisitor)
    }

    struct PointVisitor;

    impl<'de> Visitor<'de> for PointVisitor {
        type Value = Point3<f64>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a point of three numbers")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Point3<f64>, A::Error> {
            let mut coordinates = [0.0; 3];
            for (n, slot) in coordinates.iter_mut().enumerate() {
                *slot = seq
                    .next_element()?
                    .ok_or_else(|| A::Error::invalid_length(n, &self))?;
            }
            if seq.next_element::<f64>()?.is_some() {
                return Err(A::Error::invalid_length(4, &self));
            }
            Ok(Point3::from(coordinates))
        }
    }
}
