//! Chains of bones as arcs: where one bone hands over to the next, and which bones of two chains
//! of different length share a stretch.

use glam::DVec3;

use crate::rig::Skeleton;

/// Bones whose heads lie closer than this share of the chain share their stretch evenly: twist
/// bones that start where their limb starts.
const TOO_CLOSE: f64 = 0.05;

/// Two bones share a stretch when their common part is at least this share of the shorter one.
const SHARED: f64 = 0.3;

/// Points P₀…P_k where a chain of k bones starts, hands over from bone to bone, and ends.
pub(super) fn joints(skeleton: &Skeleton, bones: &[u32]) -> Vec<DVec3> {
    let heads: Vec<DVec3> = bones.iter().map(|&b| skeleton.heads()[b as usize]).collect();
    let (Some(&start), Some(&last)) = (heads.first(), bones.last()) else {
        return Vec::new();
    };
    let end = match *bones {
        [bone] => end_of(skeleton, bone, bones),
        _ => {
            // The bone of a limb that reaches farthest tells where the limb ends.
            let ends = bones.iter().map(|&bone| end_of(skeleton, bone, bones));
            let farthest =
                |best: DVec3, p: DVec3| if p.distance(start) > best.distance(start) { p } else { best };
            if heads_in_order(&heads, end_of(skeleton, last, bones)) {
                end_of(skeleton, last, bones)
            } else {
                ends.fold(start, farthest)
            }
        }
    };
    let mut points = heads.clone();
    points.push(end);
    if !heads_in_order(&heads, end) {
        let count = bones.len() as f64;
        points = (0..=bones.len()).map(|i| start.lerp(end, i as f64 / count)).collect();
    }
    points
}

fn heads_in_order(heads: &[DVec3], end: DVec3) -> bool {
    let points: Vec<DVec3> = heads.iter().copied().chain([end]).collect();
    let total: f64 = points.windows(2).map(|p| p[0].distance(p[1])).sum();
    let axis = end - heads[0];
    points[..points.len() - 1]
        .windows(2)
        .all(|p| p[0].distance(p[1]) > TOO_CLOSE * total && (p[1] - p[0]).dot(axis) >= 0.0)
}

/// Where a bone ends: at the child that continues it where there is one, otherwise at its tail.
/// Some formats know no tails, so that the child tells more.
pub(super) fn end_of(skeleton: &Skeleton, bone: u32, without: &[u32]) -> DVec3 {
    let (head, tail) = (skeleton.heads()[bone as usize], skeleton.tails()[bone as usize]);
    let is_child = |b: &u32| skeleton.parents()[*b as usize] == Some(bone) && !without.contains(b);
    let children: Vec<DVec3> = (0..skeleton.bone_count() as u32)
        .filter(is_child)
        .map(|b| skeleton.heads()[b as usize])
        .filter(|&child| child.distance(head) > TOO_CLOSE * head.distance(tail))
        .collect();
    if let [only] = children[..] {
        return only;
    }
    let direction = (tail - head).normalize_or_zero();
    children
        .into_iter()
        .max_by(|a, b| (*a - head).dot(direction).total_cmp(&(*b - head).dot(direction)))
        .filter(|child| (*child - head).dot(direction) > head.distance(tail))
        .unwrap_or(tail)
}

/// Breaks of a chain as shares of its length, from 0 to 1.
fn breaks(points: &[DVec3]) -> Vec<f64> {
    let mut along = vec![0.0];
    for pair in points.windows(2) {
        along.push(along[along.len() - 1] + pair[0].distance(pair[1]));
    }
    let (total, count) = (along[along.len() - 1], (along.len() - 1).max(1) as f64);
    let share = |(i, &a): (usize, &f64)| if total > 0.0 { a / total } else { i as f64 / count };
    along.iter().enumerate().map(share).collect()
}

/// For each bone of the source chain the bones of the target chain that it shares a stretch with
/// once both chains have length 1. Chains of one count pair in order. Every bone of either chain
/// has at least one partner.
pub(super) fn shared_stretches(source: (&Skeleton, &[u32]), target: (&Skeleton, &[u32])) -> Vec<Vec<u32>> {
    let (from, to) = (source.1, target.1);
    if from.len() == to.len() {
        return to.iter().map(|&bone| vec![bone]).collect();
    }
    let s = breaks(&joints(source.0, from));
    let t = breaks(&joints(target.0, to));
    let overlap = |i: usize, j: usize| (s[i + 1].min(t[j + 1]) - s[i].max(t[j])).max(0.0);
    let mut shares: Vec<Vec<bool>> = (0..from.len())
        .map(|i| {
            let enough = |j: usize| overlap(i, j) >= SHARED * (s[i + 1] - s[i]).min(t[j + 1] - t[j]);
            (0..to.len()).map(|j| overlap(i, j) > 0.0 && enough(j)).collect()
        })
        .collect();
    let largest = |row: &mut dyn Iterator<Item = (usize, f64)>| {
        row.fold((0, -1.0), |best, found| if found.1 > best.1 { found } else { best }).0
    };
    for (i, row) in shares.iter_mut().enumerate() {
        if !row.contains(&true) {
            row[largest(&mut (0..to.len()).map(|j| (j, overlap(i, j))))] = true;
        }
    }
    for j in 0..to.len() {
        if !shares.iter().any(|row| row[j]) {
            let i = largest(&mut (0..from.len()).map(|i| (i, overlap(i, j))));
            shares[i][j] = true;
        }
    }
    shares
        .iter()
        .map(|row| to.iter().zip(row).filter(|(_, shared)| **shared).map(|(&bone, _)| bone).collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain(count: usize) -> Skeleton {
        let point = |i: usize| DVec3::X * (i as f64 / count as f64);
        let heads = (0..count).map(point).collect();
        let tails = (1..=count).map(point).collect();
        let parents: Vec<i64> = (0..count as i64).map(|i| i - 1).collect();
        Skeleton::new(heads, tails, &parents, None).unwrap()
    }

    #[test]
    fn three_bones_against_five_and_back() {
        let (three, five) = (chain(3), chain(5));
        let down = shared_stretches((&three, &[0, 1, 2]), (&five, &[0, 1, 2, 3, 4]));
        assert_eq!(down, [vec![0, 1], vec![1, 2, 3], vec![3, 4]]);
        let up = shared_stretches((&five, &[0, 1, 2, 3, 4]), (&three, &[0, 1, 2]));
        assert_eq!(up, [vec![0], vec![0, 1], vec![1], vec![1, 2], vec![2]]);
    }

    #[test]
    fn a_bone_that_starts_with_its_limb_shares_it_evenly() {
        let heads = vec![DVec3::ZERO, DVec3::X * 0.01, DVec3::X];
        let tails = vec![DVec3::X * 1.2, DVec3::X * 0.3, DVec3::X * 1.5];
        let limb = Skeleton::new(heads, tails, &[-1, 0, 0], None).unwrap();
        assert_eq!(joints(&limb, &[1, 0]), [DVec3::X * 0.01, DVec3::X * 0.505, DVec3::X]);
        assert_eq!(end_of(&limb, 0, &[0, 1]), DVec3::X);
    }
}
