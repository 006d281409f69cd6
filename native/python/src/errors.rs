//! The core's typed errors as Python exceptions.

use dermis::linalg::LinalgError;
use dermis::spectral::SpectralError;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::{PyErr, create_exception};

create_exception!(
    dermis_native,
    DermisError,
    PyException,
    "Base of every failure that is not a wrong argument."
);
create_exception!(
    dermis_native,
    NumericalError,
    DermisError,
    "A factorisation broke down or an eigen solve did not reach its residual bound."
);
create_exception!(
    dermis_native,
    RetargetError,
    DermisError,
    "The characters cannot be matched: no landmarks, no common bones, nothing to match."
);
create_exception!(
    dermis_native,
    Cancelled,
    DermisError,
    "`Progress.cancel` was called; nothing was changed."
);

/// A wrong argument.
pub(crate) fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

pub(crate) fn linalg_error(error: LinalgError) -> PyErr {
    spectral_error(error.into())
}

pub(crate) fn spectral_error(error: SpectralError) -> PyErr {
    match error {
        SpectralError::Cancelled(cancelled) => Cancelled::new_err(cancelled.to_string()),
        SpectralError::Linalg(_) => NumericalError::new_err(error.to_string()),
        SpectralError::Mesh(_)
        | SpectralError::VertexOutOfRange { .. }
        | SpectralError::PairCounts { .. } => value_error(error),
    }
}

pub(crate) fn retarget_error(error: dermis::retarget::RetargetError) -> PyErr {
    use dermis::retarget::RetargetError as Error;
    match error {
        Error::Cancelled(cancelled) => Cancelled::new_err(cancelled.to_string()),
        Error::Spectral { .. } => NumericalError::new_err(error.to_string()),
        Error::BoneMap(error) => crate::bone_map::bone_map_error(error),
        Error::Bind(error) => bind_error(error),
        Error::LandmarkOutOfRange { .. }
        | Error::WeightCounts { .. }
        | Error::Parts(_)
        | Error::PartsByPaper
        | Error::Mesh { .. }
        | Error::MapWithoutSkeletons => value_error(error),
        Error::NoWeights | Error::LandmarkOnOtherComponent { .. } | Error::TooFewLandmarks { .. } => {
            RetargetError::new_err(error.to_string())
        }
    }
}

pub(crate) fn bind_error(error: dermis::rig::BindError) -> PyErr {
    match error {
        dermis::rig::BindError::Cancelled(cancelled) => Cancelled::new_err(cancelled.to_string()),
        error => value_error(error),
    }
}
