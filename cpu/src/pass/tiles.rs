//! [`filter::tiles`](crate::filter::tiles) over whole images: which tiles of
//! 8 × 8 pixels are to be filtered, in order.

use std::ops::Range;

use glam::UVec2;

use super::svgf::for_rows;
use crate::filter::tiles::{
    TILES_NONE, tiles_at, tiles_count, tiles_flags, tiles_horizontal, tiles_needed, tiles_vertical,
};

/// The tiles of an image that a filter has to touch.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::tiles::{TILES_DARK, TILES_LIT};
/// use raytwin_cpu::pass::tiles::TileMask;
///
/// // A shadow's edge between the tiles 4 and 5 of a row of ten.
/// let read = |at: UVec2| if at.x < 40 { TILES_DARK } else { TILES_LIT };
/// let mask = TileMask::new(UVec2::new(80, 8), 1, read);
/// assert_eq!(mask.span(0), 4..6);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TileMask {
    tiles: UVec2,
    /// Row by row.
    needed: Vec<bool>,
}

impl TileMask {
    /// The mask for a filter that reaches `reach` tiles to either side
    /// (`tiles_reach`); `read(at)` gives a pixel's flags. Each side of the image
    /// is below 2^20.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::tiles::{TILES_DARK, TILES_LIT};
    /// use raytwin_cpu::pass::tiles::TileMask;
    ///
    /// // A shadow's edge between the tiles 4 and 5 of a row of ten.
    /// let read = |at: UVec2| if at.x < 40 { TILES_DARK } else { TILES_LIT };
    /// let mask = TileMask::new(UVec2::new(80, 8), 1, read);
    /// assert!(
    ///     mask.is_needed(UVec2::new(4, 0)) && !mask.is_needed(UVec2::new(3, 0))
    /// );
    /// ```
    #[must_use]
    pub fn new(size: UVec2, reach: u32, read: impl Fn(UVec2) -> u32 + Sync + Send) -> Self {
        Self::from_tiles(size, reach, |tile| tiles_flags(tile, size, &read))
    }

    /// As [`Self::new`], from the flags of whole tiles.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::tiles::{TILES_DARK, TILES_LIT};
    /// use raytwin_cpu::pass::tiles::TileMask;
    ///
    /// let read = |tile: UVec2| if tile.x < 5 { TILES_DARK } else { TILES_LIT };
    /// let mask = TileMask::from_tiles(UVec2::new(80, 8), 2, read);
    /// assert_eq!(mask.span(0), 3..7);
    /// ```
    #[must_use]
    pub fn from_tiles(size: UVec2, reach: u32, read: impl Fn(UVec2) -> u32 + Sync + Send) -> Self {
        let tiles = tiles_count(size);
        let across = tiles.x as usize;
        let index = |tile: UVec2| tile.y as usize * across + tile.x as usize;
        let each = |out: &mut [u32], make: &(dyn Fn(UVec2) -> u32 + Sync)| {
            for_rows(out, across.max(1), |y, row| {
                for (x, flags) in row.iter_mut().enumerate() {
                    *flags = make(UVec2::new(x as u32, y as u32));
                }
            });
        };
        let mut own = vec![TILES_NONE; across * tiles.y as usize];
        let (mut rows, mut around) = (own.clone(), own.clone());
        let reach = reach.min(1 << 20);
        each(&mut own, &read);
        each(&mut rows, &|tile| {
            tiles_horizontal(tile, tiles, reach, |t| own[index(t)])
        });
        each(&mut around, &|tile| {
            tiles_vertical(tile, tiles, reach, |t| rows[index(t)])
        });
        let needed = own.iter().zip(&around);
        Self {
            tiles,
            needed: needed.map(|(o, a)| tiles_needed(*o, *a) != 0).collect(),
        }
    }

    /// Tiles across and down.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::tiles::TILES_LIT;
    /// use raytwin_cpu::pass::tiles::TileMask;
    ///
    /// let mask = TileMask::new(UVec2::new(1920, 1080), 8, |_| TILES_LIT);
    /// assert_eq!(mask.tiles(), UVec2::new(240, 135));
    /// ```
    #[must_use]
    pub fn tiles(&self) -> UVec2 {
        self.tiles
    }

    /// Whether a tile is to be filtered; one outside is not.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::tiles::{TILES_DARK, TILES_LIT};
    /// use raytwin_cpu::pass::tiles::TileMask;
    ///
    /// // A shadow's edge between the tiles 4 and 5 of a row of ten.
    /// let read = |at: UVec2| if at.x < 40 { TILES_DARK } else { TILES_LIT };
    /// let mask = TileMask::new(UVec2::new(80, 8), 1, read);
    /// assert!(mask.is_needed(UVec2::new(4, 0)));
    /// assert!(
    ///     !mask.is_needed(UVec2::new(0, 0)) && !mask.is_needed(UVec2::new(99, 0))
    /// );
    /// ```
    #[must_use]
    pub fn is_needed(&self, tile: UVec2) -> bool {
        let inside = tile.x < self.tiles.x && tile.y < self.tiles.y;
        inside && self.needed[tile.y as usize * self.tiles.x as usize + tile.x as usize]
    }

    /// The tiles of a row from the first to the last that is to be filtered.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::tiles::{TILES_DARK, TILES_LIT};
    /// use raytwin_cpu::pass::tiles::TileMask;
    ///
    /// // A shadow's edge between the tiles 4 and 5 of a row of ten.
    /// let read = |at: UVec2| if at.x < 40 { TILES_DARK } else { TILES_LIT };
    /// let mask = TileMask::new(UVec2::new(80, 8), 1, read);
    /// assert_eq!(mask.span(0), 4..6);
    /// ```
    #[must_use]
    pub fn span(&self, row: u32) -> Range<u32> {
        let columns = || (0..self.tiles.x).filter(|x| self.is_needed(UVec2::new(*x, row)));
        match (columns().next(), columns().next_back()) {
            (Some(first), Some(last)) => first..last + 1,
            _ => 0..0,
        }
    }

    /// The tiles to filter, row by row.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::tiles::{TILES_DARK, TILES_LIT};
    /// use raytwin_cpu::pass::tiles::TileMask;
    ///
    /// // A shadow's edge between the tiles 4 and 5 of a row of ten.
    /// let read = |at: UVec2| if at.x < 40 { TILES_DARK } else { TILES_LIT };
    /// let mask = TileMask::new(UVec2::new(80, 8), 1, read);
    /// let needed: Vec<_> = mask.iter().collect();
    /// assert_eq!(needed, [UVec2::new(4, 0), UVec2::new(5, 0)]);
    /// ```
    pub fn iter(&self) -> impl Iterator<Item = UVec2> + '_ {
        let needed = (0..).zip(&self.needed).filter(|(_, needed)| **needed);
        needed.map(|(i, _)| tiles_at(i, self.tiles.x))
    }

    /// How many tiles are to be filtered.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::tiles::{TILES_DARK, TILES_LIT};
    /// use raytwin_cpu::pass::tiles::TileMask;
    ///
    /// // A shadow's edge between the tiles 4 and 5 of a row of ten.
    /// let read = |at: UVec2| if at.x < 40 { TILES_DARK } else { TILES_LIT };
    /// let mask = TileMask::new(UVec2::new(80, 8), 1, read);
    /// assert_eq!(mask.count(), 2);
    /// // Nothing but light: nothing to do.
    /// assert_eq!(TileMask::new(UVec2::new(80, 8), 1, |_| TILES_LIT).count(), 0);
    /// ```
    #[must_use]
    pub fn count(&self) -> usize {
        self.needed.iter().filter(|needed| **needed).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::tiles::{TILES_LIT, TILES_MIXED};

    #[test]
    fn the_list_is_the_mask_in_order() {
        let size = UVec2::new(100, 70);
        let spot = UVec2::new(50, 30);
        let read = |at| if at == spot { TILES_MIXED } else { TILES_LIT };
        let mask = TileMask::new(size, 1, read);
        assert_eq!(mask.tiles(), UVec2::new(13, 9));
        let list: Vec<_> = mask.iter().map(|t| t.to_array()).collect();
        assert_eq!(
            list,
            [
                [5, 2],
                [6, 2],
                [7, 2],
                [5, 3],
                [6, 3],
                [7, 3],
                [5, 4],
                [6, 4],
                [7, 4]
            ]
        );
        assert_eq!(mask.count(), 9);
        for i in 0..13 * 9 {
            let tile = tiles_at(i, 13);
            assert_eq!(mask.is_needed(tile), list.contains(&tile.to_array()));
        }
        assert!(!mask.is_needed(UVec2::new(13, 3)));
        assert_eq!(
            (mask.span(3), mask.span(5), mask.span(99)),
            (5..8, 0..0, 0..0)
        );
    }

    #[test]
    fn no_image_is_no_trouble() {
        for size in [UVec2::ZERO, UVec2::new(0, 9), UVec2::new(9, 0)] {
            let mask = TileMask::new(size, 8, |_| -> u32 { panic!("a pixel was read") });
            assert_eq!(mask.count(), 0);
        }
    }
}
