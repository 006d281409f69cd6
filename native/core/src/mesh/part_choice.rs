//! What the user wants to become of the loose parts of a mesh: the pieces that are connected once seams
//! that only an export had opened are closed.

use super::{TriangleMesh, weld_seams};

/// Treatments of loose parts; the default of `P` means that none is chosen.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PartChoice<P> {
    /// One for all parts but the body.
    All(P),
    /// One for each component of the mesh, numbered as [`super::Topology::components`] does; here the
    /// body counts like any other part.
    Each(Vec<P>),
}

impl<P: Default> Default for PartChoice<P> {
    fn default() -> Self {
        Self::All(P::default())
    }
}

/// Treatments that do not fit the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PartChoiceError {
    /// Not one for each component.
    #[error("treatments of loose parts were given for {given} components, but the mesh has {expected}")]
    Counts {
        /// Treatments given.
        given: usize,
        /// Components of the mesh.
        expected: usize,
    },
    /// Two components are one part.
    #[error(
        "components {first} and {second} of the mesh touch at coincident open edges and are one part, but are to be \
         treated in two ways"
    )]
    Conflict {
        /// A component.
        first: u32,
        /// Another one of the same part.
        second: u32,
    },
}

/// Treatments that fit the mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResolvedChoice<P> {
    all: P,
    /// Treatment of each vertex (V), by its component.
    each: Option<Vec<P>>,
}

impl<P: Copy + Default + PartialEq> PartChoice<P> {
    /// The choice for one mesh.
    ///
    /// # Errors
    /// [`PartChoiceError`] unless there is one treatment for each component, and not two of one part.
    pub fn resolved(&self, mesh: &TriangleMesh) -> Result<ResolvedChoice<P>, PartChoiceError> {
        let each = match self {
            Self::All(policy) => return Ok(ResolvedChoice { all: *policy, each: None }),
            Self::Each(each) => each,
        };
        let topology = mesh.topology();
        let (components, expected) = (topology.components(), topology.component_count());
        if each.len() != expected {
            return Err(PartChoiceError::Counts { given: each.len(), expected });
        }
        let stands_for = weld_seams(mesh);
        let triangles = mesh.triangles().iter().map(|t| t.map(|v| stands_for[v as usize])).collect();
        let welded = TriangleMesh::new(mesh.vertices().to_vec(), triangles)
            .unwrap_or_else(|_| mesh.clone())
            .topology();
        // The first component of each part that something was chosen for.
        let mut chosen: Vec<Option<u32>> = vec![None; welded.component_count()];
        for (vertex, &component) in components.iter().enumerate() {
            if each[component as usize] == P::default() {
                continue;
            }
            let part = welded.components()[stands_for[vertex] as usize] as usize;
            let first = *chosen[part].get_or_insert(component);
            if each[first as usize] != each[component as usize] {
                return Err(PartChoiceError::Conflict { first, second: component });
            }
        }
        let each = components.iter().map(|&component| each[component as usize]).collect();
        Ok(ResolvedChoice { all: P::default(), each: Some(each) })
    }
}

impl<P: Copy + Default + PartialEq> ResolvedChoice<P> {
    /// The treatment of a part with these vertices; the default where none was chosen.
    pub fn of(&self, vertices: &[u32], is_body: bool) -> P {
        match &self.each {
            None if is_body => P::default(),
            None => self.all,
            Some(each) => {
                let mut policies = vertices.iter().map(|&v| each[v as usize]);
                policies.find(|policy| *policy != P::default()).unwrap_or_default()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Two triangles that only share positions of one side, and one far away.
    fn mesh() -> TriangleMesh {
        let corners = [[0, 0], [1, 0], [0, 1], [1, 0], [1, 1], [0, 1], [8, 8], [9, 8], [8, 9]];
        let vertices = corners.map(|[x, y]| DVec3::new(f64::from(x), f64::from(y), 0.0)).to_vec();
        TriangleMesh::new(vertices, vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]]).unwrap()
    }

    #[test]
    fn a_choice_for_all_leaves_the_body_out() {
        let choice = PartChoice::All(7).resolved(&mesh()).unwrap();
        assert_eq!((choice.of(&[0], true), choice.of(&[6], false)), (0, 7));
    }

    #[test]
    fn a_choice_for_one_component_holds_for_its_part() {
        let resolved = PartChoice::Each(vec![0, 7, 8]).resolved(&mesh()).unwrap();
        assert_eq!((resolved.of(&[0, 1, 2, 3, 4, 5], true), resolved.of(&[6], false)), (7, 8));
        let conflict = PartChoice::Each(vec![8, 7, 0]).resolved(&mesh());
        assert_eq!(conflict, Err(PartChoiceError::Conflict { first: 0, second: 1 }));
        let wrong = PartChoice::Each(vec![0; 2]).resolved(&mesh());
        assert_eq!(wrong, Err(PartChoiceError::Counts { given: 2, expected: 3 }));
    }
}
