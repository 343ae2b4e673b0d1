//! Serialisation of a lens by serde: its parameters by name, and the radius up to which it is
//! trusted.
//!
//! Quantities that a lens computes from its parameters are not stored but computed again. JSON has
//! no infinity: the radius of a lens that is trusted everywhere is null; it may be omitted as well.
//!
//! A struct with a field for any lens names this module:
//! `#[serde(with = "trisquare::lens::stored")]`.

use std::collections::BTreeMap;

use nalgebra::Matrix3;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{Brown, Fisheye, Lens, OpenCvLens, OpenCvModel};

#[derive(Serialize, Deserialize)]
struct Stored {
    /// Values by name, see [`Lens::parameter_names`].
    parameters: BTreeMap<String, f64>,
    /// In the lens's own measure, see [`Lens::valid_radius`]; null if it is infinite.
    valid_radius: Option<f64>,
}

/// Stores a lens.
///
/// # Errors
/// Those of the serializer.
pub fn serialize<L: Lens, S: Serializer>(lens: &L, serializer: S) -> Result<S::Ok, S::Error> {
    let names = L::parameter_names().iter().map(|name| (*name).to_owned());
    let radius = lens.valid_radius();
    let stored = Stored {
        parameters: names.zip(lens.parameters()).collect(),
        valid_radius: radius.is_finite().then_some(radius),
    };
    stored.serialize(serializer)
}

/// Reads a lens back.
///
/// # Errors
/// Those of the deserializer, and an error if the parameters are those of another lens or not
/// finite, or a focal length is not positive.
pub fn deserialize<'de, L: Lens, D: Deserializer<'de>>(deserializer: D) -> Result<L, D::Error> {
    let stored = Stored::deserialize(deserializer)?;
    let names = L::parameter_names();
    let value = |name: &&str| stored.parameters.get(*name).copied();
    let values: Option<Vec<f64>> = names.iter().map(value).collect();
    let values = values.filter(|values| values.len() == stored.parameters.len());
    let values = values.ok_or_else(|| {
        let found: Vec<&str> = stored.parameters.keys().map(String::as_str).collect();
        D::Error::custom(format!(
            "the lens has the parameters {}, not {}",
            names.join(", "),
            found.join(", ")
        ))
    })?;
    if !values.iter().all(|value| value.is_finite()) {
        return Err(D::Error::custom("the parameters of a lens must be finite"));
    }
    let radius = stored.valid_radius.unwrap_or(f64::INFINITY);
    if !(values[..2].iter().all(|focal| *focal > 0.0) && radius >= 0.0) {
        return Err(D::Error::custom(
            "the focal lengths of a lens must be positive, and its valid radius not negative",
        ));
    }
    let lens = L::from_camera_matrix(&Matrix3::identity()).with_parameters(&values);
    Ok(lens.within(radius))
}

/// A lens that may be absent: `#[serde(with = "trisquare::lens::stored::option")]`.
pub mod option {
    use super::{Deserialize, Deserializer, Lens, Serialize, Serializer};

    #[derive(Serialize, Deserialize)]
    #[serde(bound = "")]
    struct Own<L: Lens>(#[serde(with = "super")] L);

    /// Stores a lens or its absence.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<L: Lens, S: Serializer>(
        lens: &Option<L>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        lens.map(Own).serialize(serializer)
    }

    /// Reads a lens or its absence back.
    ///
    /// # Errors
    /// As [`super::deserialize`].
    pub fn deserialize<'de, L: Lens, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<L>, D::Error> {
        let own = Option::<Own<L>>::deserialize(deserializer)?;
        Ok(own.map(|Own(lens)| lens))
    }
}

/// Implements serde's traits for a lens itself.
macro_rules! stored {
    ($lens:ty $(, $model:ident: $bound:ident)?) => {
        impl$(<$model: $bound>)? Serialize for $lens {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serialize(self, serializer)
            }
        }

        impl<'de $(, $model: $bound)?> Deserialize<'de> for $lens {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserialize(deserializer)
            }
        }
    };
}

stored!(Brown);
stored!(Fisheye);
stored!(OpenCvLens<M>, M: OpenCvModel);

#[cfg(test)]
mod tests {
    use super::super::{Rational, ThinPrism};
    use super::*;

    const INTRINSICS: [f64; 4] = [900.1, 910.2, 640.3, 470.4];

    fn stored_and_read<L: Lens + Serialize + for<'de> Deserialize<'de>>(lens: &L) -> L {
        serde_json::from_str(&serde_json::to_string(lens).unwrap()).unwrap()
    }

    fn check<L: Lens + Serialize + for<'de> Deserialize<'de>>(pinhole: L, lens: L) {
        for own in [
            pinhole,
            lens,
            lens.within(0.3),
            lens.with_camera_matrix(&Matrix3::new(
                900.0, 1.5, 640.0, 0.0, 910.0, 470.0, 0.0, 0.0, 1.0,
            )),
        ] {
            assert_eq!(stored_and_read(&own), own);
        }
    }

    #[test]
    fn every_lens_is_read_back_as_it_was() {
        let [fx, fy, cx, cy] = INTRINSICS;
        let brown = |k1, k2| Brown::new([fx, fy, cx, cy, k1, k2, -0.01, 0.002, -0.001]);
        assert!(
            Brown::new([fx, fy, cx, cy, 0.1, 0.0, 0.0, 0.0, 0.0])
                .valid_radius()
                .is_infinite()
        );
        check(
            Brown::new([fx, fy, cx, cy, 0.1, 0.0, 0.0, 0.0, 0.0]),
            brown(-0.3, 0.08),
        );
        check(
            Fisheye::new([fx, fy, cx, cy, 0.0, 0.0, 0.0, 0.0]),
            Fisheye::new([fx, fy, cx, cy, 0.02, -0.01, 0.003, -0.001]),
        );
        let coefficients = [
            0.4, 0.1, 0.01, 0.6, 0.2, 0.02, 1e-3, -2e-3, 3e-3, 4e-4, -5e-3, 6e-4,
        ];
        check(
            Rational::new(INTRINSICS, &[]),
            Rational::new(INTRINSICS, &coefficients[..8]),
        );
        check(
            ThinPrism::new(INTRINSICS, &[]),
            ThinPrism::new(INTRINSICS, &coefficients),
        );
    }

    #[test]
    fn another_lens_or_no_number_is_refused() {
        let text = serde_json::to_string(&Brown::new([1.0; 9])).unwrap();
        let refused = serde_json::from_str::<Fisheye>(&text).unwrap_err();
        assert!(refused.to_string().contains("k4"), "{refused}");
        let fewer = text.replace("\"p2\":1.0,", "");
        assert_ne!(fewer, text);
        assert!(serde_json::from_str::<Brown>(&fewer).is_err());
        for (own, wrong) in [
            ("\"fx\":1.0", "\"fx\":0.0"),
            ("\"fy\":1.0", "\"fy\":-1.0"),
            ("\"valid_radius\":", "\"valid_radius\":-"),
        ] {
            let changed = text.replace(own, wrong);
            assert_ne!(changed, text);
            let refused = serde_json::from_str::<Brown>(&changed).unwrap_err();
            assert!(refused.to_string().contains("positive"), "{refused}");
        }
        let no_number = text.replace("\"fx\":1.0", "\"fx\":null");
        assert_ne!(no_number, text);
        assert!(serde_json::from_str::<Brown>(&no_number).is_err());
    }
}
