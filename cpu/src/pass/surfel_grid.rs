//! [`gi::surfel_grid`](crate::gi::surfel_grid) for all surfels: the lists of
//! all cells.
//!
//! Count, sum, scatter. A list holds each surfel once, in the order of their
//! numbers; so does the GPU's, which sorts, since its scatter has no order.
//! Entries are first dealt to groups of neighbouring slots, so that what is
//! counted and scattered at a time fits into a cache. Surfels are dealt some
//! thousands at a time, and groups are built each for itself: in parallel with
//! the feature `rayon`, and no order of threads changes a list.

use glam::{UVec2, Vec3};

use super::svgf::for_rows;
use crate::gi::surfel::Surfel;
use crate::gi::surfel_grid::{
    SURFEL_GRID_NOWHERE, SurfelGrid, surfel_grid_cell, surfel_grid_count, surfel_grid_find,
    surfel_grid_kept, surfel_grid_levels, surfel_grid_range, surfel_grid_slot,
};

/// The lists of a grid. Keep it: a build reuses its memory.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
/// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
///
/// let grid = SurfelGrid {
///     origin: Vec3::splat(-2.0),
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
/// let mut lists = SurfelGridPass::new(grid, 100);
/// lists.build(&[surfel]);
/// // First entry and length of the list around the surfel.
/// let list = lists.list(surfel.position);
/// assert_eq!((list.y, lists.entry(list.x)), (1, 0));
/// ```
#[derive(Clone, Debug)]
pub struct SurfelGridPass {
    grid: SurfelGrid,
    capacity: u32,
    first: Vec<u32>,
    count: Vec<u32>,
    hands: Vec<Hand>,
    entries: Vec<u32>,
    dropped: u32,
    homeless: u32,
}

/// Groups of slots.
const GROUPS: usize = 256;

/// Surfels that are dealt together.
const DEALT: usize = 16_384;

/// An entry to be: a surfel in the list of a slot.
#[derive(Clone, Copy, Debug)]
struct Listed {
    slot: u32,
    surfel: u32,
}

/// Entries of surfels that were dealt together, by group.
#[derive(Clone, Debug)]
struct Hand {
    groups: Vec<Vec<Listed>>,
    homeless: u32,
}

impl Hand {
    /// Deals surfels, of which the first has the number `from`, to groups of
    /// `2^shift` slots.
    fn deal(&mut self, from: u32, surfels: &[Surfel], grid: SurfelGrid, shift: u32) {
        self.homeless = 0;
        for group in &mut self.groups {
            group.clear();
        }
        for (number, place) in (from..).zip(surfels) {
            let groups = &mut self.groups;
            let whole = for_slots(*place, grid, |slot| {
                let surfel = number;
                groups[(slot >> shift) as usize].push(Listed { slot, surfel });
            });
            self.homeless += u32::from(!whole);
        }
    }
}

/// The lists of a group's slots.
struct Group<'a> {
    firsts: &'a mut [u32],
    counts: &'a mut [u32],
    /// From the entry `at` on, as far as there is room.
    entries: &'a mut [u32],
    at: u32,
    dropped: u32,
}

impl Group<'_> {
    /// Builds the lists of what was dealt to group `index`, of `span` slots.
    fn build(&mut self, hands: &[Hand], index: usize, span: usize, capacity: u32) {
        let dealt = || hands.iter().flat_map(|hand| &hand.groups[index]);
        let mut cells = vec![Cell::default(); span];
        for listed in dealt() {
            cells[listed.slot as usize & (span - 1)].count += 1;
        }
        let mut at = self.at;
        for (cell, first) in cells.iter_mut().zip(self.firsts.iter_mut()) {
            let kept = surfel_grid_kept(at, cell.count, capacity);
            *first = at;
            cell.next = at;
            cell.end = at.saturating_add(kept);
            self.dropped = self.dropped.saturating_add(cell.count - kept);
            at = at.saturating_add(cell.count);
        }
        for Listed { slot, surfel } in dealt() {
            let cell = &mut cells[*slot as usize & (span - 1)];
            let known = cell.last == surfel.wrapping_add(1);
            if cell.next < cell.end && !known {
                self.entries[(cell.next - self.at) as usize] = *surfel;
                cell.next += 1;
                cell.last = surfel.wrapping_add(1);
            }
        }
        for (count, (first, cell)) in self.counts.iter_mut().zip(self.firsts.iter().zip(&cells)) {
            *count = cell.next - first;
        }
    }
}

/// A slot while its list is built, in one place of memory.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    /// Entries, those that are there twice counted twice.
    count: u32,
    /// Where the next entry goes, and the end of the list.
    next: u32,
    end: u32,
    /// One more than the number of the surfel that was placed last.
    last: u32,
}

/// Every slot that a surfel is listed in; a hash may give one twice. False if
/// a level, or the whole, has more cells than a surfel may touch.
fn for_slots(surfel: Surfel, grid: SurfelGrid, mut work: impl FnMut(u32)) -> bool {
    let levels = surfel_grid_levels(surfel, grid);
    let mut whole = levels.y > 0;
    for level in levels.x..levels.x + levels.y {
        let range = surfel_grid_range(surfel, level, grid);
        let count = surfel_grid_count(range);
        whole &= count > 0;
        for k in 0..count {
            let slot = surfel_grid_slot(surfel_grid_cell(range, k), level, grid);
            if slot != SURFEL_GRID_NOWHERE {
                work(slot);
            }
        }
    }
    whole
}

impl SurfelGridPass {
    /// For lists with `capacity` entries in all.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let lists = SurfelGridPass::new(grid, 100);
    /// assert_eq!(lists.firsts().len(), 512);
    /// assert_eq!(lists.list(Vec3::ZERO).y, 0);
    /// ```
    #[must_use]
    pub fn new(grid: SurfelGrid, capacity: u32) -> Self {
        let slots = grid.slots as usize;
        Self {
            grid,
            capacity,
            first: vec![0; slots],
            count: vec![0; slots],
            hands: Vec::new(),
            entries: Vec::new(),
            dropped: 0,
            homeless: 0,
        }
    }

    /// Builds the lists anew.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let mut lists = SurfelGridPass::new(grid, 100);
    /// lists.build(&[surfel]);
    /// assert_eq!(lists.list(surfel.position).y, 1);
    /// // Built anew without it.
    /// lists.build(&[]);
    /// assert_eq!(lists.list(surfel.position).y, 0);
    /// ```
    pub fn build(&mut self, surfels: &[Surfel]) {
        let span = self.first.len().div_ceil(GROUPS).next_power_of_two();
        let shift = span.trailing_zeros();
        let grid = self.grid;
        self.hands
            .resize_with(surfels.len().div_ceil(DEALT), || Hand {
                groups: vec![Vec::new(); GROUPS],
                homeless: 0,
            });
        if !surfels.is_empty() {
            for_rows(&mut self.hands, 1, |i, hand| {
                let from = i * DEALT;
                let part = &surfels[from..surfels.len().min(from + DEALT)];
                hand[0].deal(from as u32, part, grid, shift);
            });
        }
        let hands = &self.hands;
        self.homeless = hands.iter().map(|hand| hand.homeless).sum();
        let size = |group: usize| {
            let sizes = hands.iter().map(|hand| hand.groups[group].len() as u32);
            sizes.fold(0, u32::saturating_add)
        };
        let all = (0..GROUPS).map(size).fold(0, u32::saturating_add);
        self.entries.clear();
        self.entries.resize(all.min(self.capacity) as usize, 0);
        let mut groups = Vec::with_capacity(GROUPS);
        let (mut at, mut rest) = (0u32, &mut self.entries[..]);
        let lists = self.first.chunks_mut(span).zip(self.count.chunks_mut(span));
        for (index, (firsts, counts)) in lists.enumerate() {
            let (entries, others) = rest.split_at_mut((size(index) as usize).min(rest.len()));
            rest = others;
            groups.push(Group {
                firsts,
                counts,
                entries,
                at,
                dropped: 0,
            });
            at = at.saturating_add(size(index));
        }
        if !groups.is_empty() {
            let capacity = self.capacity;
            for_rows(&mut groups, 1, |index, group| {
                group[0].build(hands, index, span, capacity);
            });
        }
        let dropped = groups.iter().map(|group| group.dropped);
        self.dropped = dropped.fold(0, u32::saturating_add);
    }

    /// The cells.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// assert_eq!(SurfelGridPass::new(grid, 100).grid(), grid);
    /// ```
    #[must_use]
    pub fn grid(&self) -> SurfelGrid {
        self.grid
    }

    /// First entry and length of the list that a point looks up.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let mut lists = SurfelGridPass::new(grid, 100);
    /// lists.build(&[surfel]);
    /// assert_eq!(lists.list(surfel.position).y, 1);
    /// // Far from the surfel, and outside of the grid.
    /// assert_eq!(lists.list(Vec3::splat(1.5)).y, 0);
    /// assert_eq!(lists.list(Vec3::splat(99.0)).y, 0);
    /// ```
    #[must_use]
    pub fn list(&self, point: Vec3) -> UVec2 {
        let slot = surfel_grid_find(point, self.grid);
        if slot == SURFEL_GRID_NOWHERE {
            return UVec2::ZERO;
        }
        UVec2::new(self.first[slot as usize], self.count[slot as usize])
    }

    /// The surfel that an entry names.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let mut lists = SurfelGridPass::new(grid, 100);
    /// lists.build(&[surfel, surfel]);
    /// // In the order of their numbers.
    /// let list = lists.list(surfel.position);
    /// let found: Vec<_> =
    ///     (list.x..list.x + list.y).map(|i| lists.entry(i)).collect();
    /// assert_eq!(found, [0, 1]);
    /// ```
    #[inline]
    #[must_use]
    pub fn entry(&self, entry: u32) -> u32 {
        self.entries[entry as usize]
    }

    /// Where each slot's list begins.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::{SurfelGrid, surfel_grid_find};
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let mut lists = SurfelGridPass::new(grid, 100);
    /// lists.build(&[surfel]);
    /// let slot = surfel_grid_find(surfel.position, grid);
    /// assert_eq!(lists.firsts()[slot as usize], lists.list(surfel.position).x);
    /// ```
    #[must_use]
    pub fn firsts(&self) -> &[u32] {
        &self.first
    }

    /// How long each slot's list is.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let mut lists = SurfelGridPass::new(grid, 100);
    /// lists.build(&[surfel]);
    /// let total: u32 = lists.counts().iter().sum();
    /// assert_eq!(total as usize, lists.entries().len());
    /// ```
    #[must_use]
    pub fn counts(&self) -> &[u32] {
        &self.count
    }

    /// The surfels' numbers, list after list.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let mut lists = SurfelGridPass::new(grid, 100);
    /// lists.build(&[surfel]);
    /// // Every entry names the one surfel there is.
    /// assert!(lists.entries().iter().all(|number| *number == 0));
    /// ```
    #[must_use]
    pub fn entries(&self) -> &[u32] {
        &self.entries
    }

    /// Entries that the capacity had no room for.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// // Room for one entry, and the surfel touches more cells.
    /// let mut lists = SurfelGridPass::new(grid, 1);
    /// lists.build(&[surfel]);
    /// assert!(lists.dropped() > 0);
    /// ```
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Surfels that are not sound, or too large for their cells.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel_grid::SurfelGridPass;
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let mut lists = SurfelGridPass::new(grid, 100);
    /// // Much larger than a cell of half a metre.
    /// lists.build(&[surfel, Surfel { radius: 5.0, ..surfel }]);
    /// assert_eq!(lists.homeless(), 1);
    /// ```
    #[must_use]
    pub fn homeless(&self) -> u32 {
        self.homeless
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gi::surfel::surfel_coverage;
    use crate::random::pcg::{pcg_hash, pcg_unit};
    use glam::UVec3;

    fn random(i: u32) -> f32 {
        pcg_unit(pcg_hash(i))
    }

    fn cloud(count: u32) -> Vec<Surfel> {
        (0..count)
            .map(|i| {
                let at = |k: u32| random(i * 8 + k);
                Surfel {
                    position: Vec3::new(at(0), at(1), at(2)) * 4.0,
                    radius: 0.1 + 0.1 * at(3),
                    normal: Vec3::new(at(4) - 0.5, at(5) - 0.5, at(6) + 0.1).normalize(),
                    mesh: 0,
                }
            })
            .collect()
    }

    fn grid(slots: u32) -> SurfelGrid {
        SurfelGrid {
            origin: Vec3::ZERO,
            inverse_cell: 4.0,
            size: UVec3::ZERO,
            slots,
            inverse_reach: 0.0,
        }
    }

    #[test]
    fn lists_give_the_coverage_of_all_surfels() {
        let surfels = cloud(900);
        // A cell around the room on each side: points beside it count too.
        let dense = SurfelGrid {
            origin: Vec3::splat(-0.25),
            size: UVec3::splat(18),
            slots: 18 * 18 * 18,
            ..grid(0)
        };
        let levels = SurfelGrid {
            inverse_reach: 1.0,
            ..grid(1021)
        };
        // Even a hash with seven slots: each list nearly all of the surfels.
        for grid in [grid(1021), grid(7), dense, levels] {
            let mut pass = SurfelGridPass::new(grid, 1 << 20);
            pass.build(&surfels);
            assert_eq!((pass.dropped(), pass.homeless()), (0, 0));
            let mut covered = 0;
            for i in 0..2000 {
                let j = 1_000_000 + i * 3;
                let near = surfels[i as usize % 900];
                let off = Vec3::new(random(j), random(j + 1), random(j + 2)) - 0.5;
                let (p, n) = (near.position + off * 0.15, near.normal);
                let ours = surfel_coverage(p, n, pass.list(p), |e| surfels[pass.entry(e) as usize]);
                let all = surfel_coverage(p, n, UVec2::new(0, 900), |e| surfels[e as usize]);
                assert_eq!(ours, all, "{p} {grid:?}");
                covered += u32::from(all > 0.0);
            }
            assert!(covered > 500);
        }
    }

    #[test]
    fn lists_are_sorted_and_hold_each_surfel_once() {
        let surfels = cloud(2000);
        let mut pass = SurfelGridPass::new(grid(13), 1 << 20);
        pass.build(&surfels);
        for (first, count) in pass.firsts().iter().zip(pass.counts()) {
            let list = &pass.entries()[*first as usize..(first + count) as usize];
            assert!(list.windows(2).all(|w| w[0] < w[1]));
        }
    }

    #[test]
    fn a_full_grid_drops_and_counts() {
        let mut surfels = cloud(2000);
        let mut roomy = SurfelGridPass::new(grid(101), 1 << 20);
        roomy.build(&surfels);
        for capacity in [0, 1, 100, 5000] {
            let mut pass = SurfelGridPass::new(grid(101), capacity);
            pass.build(&surfels);
            assert!(pass.entries().len() <= capacity as usize);
            assert!(pass.dropped() > 0);
            // What is kept is what it would have been.
            for slot in 0..101 {
                let n = pass.counts()[slot] as usize;
                let at = pass.firsts()[slot] as usize;
                if n > 0 {
                    assert_eq!(n, roomy.counts()[slot] as usize);
                    assert_eq!(pass.entries()[at..at + n], roomy.entries()[at..at + n]);
                }
            }
        }
        surfels[3].radius = 100.0;
        surfels[5].normal = Vec3::NAN;
        roomy.build(&surfels);
        assert_eq!(roomy.homeless(), 2);
        let mut none = SurfelGridPass::new(grid(0), 100);
        none.build(&surfels);
        assert_eq!(none.list(Vec3::ZERO), UVec2::ZERO);
    }
}
