//! Pairs of vertices put together by their first vertex, so that one search serves a whole group.

/// Indices of the pairs with the same first vertex, groups and members in ascending order.
pub(crate) fn grouped_by_source(pairs: &[(u32, u32)]) -> Vec<Vec<u32>> {
    let mut order: Vec<u32> = (0..pairs.len() as u32).collect();
    order.sort_unstable_by_key(|&i| (pairs[i as usize], i));
    order
        .chunk_by(|&i, &j| pairs[i as usize].0 == pairs[j as usize].0)
        .map(<[u32]>::to_vec)
        .collect()
}

/// The answers of all groups in the order of the pairs.
pub(crate) fn in_order_of_pairs(
    groups: &[Vec<u32>],
    answers: impl IntoIterator<Item = f64>,
) -> Vec<f64> {
    let members = groups.iter().flatten();
    let mut ordered = vec![0.0; members.clone().count()];
    for (&i, answer) in members.zip(answers) {
        ordered[i as usize] = answer;
    }
    ordered
}
