//! Plots with logarithmic axes, as SVG.
//!
//! Drawn by plotters onto fixed pixels, without its axes: those need to know
//! how wide text is, and this machine may have no font. Text and lines take
//! the colour of the text around the plot, so one file serves light and dark.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::error::ReportError;

/// How an axis is marked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ticks {
    /// 1, 2, 5, 10, …; only powers of ten over a wide range.
    Decimal,
    /// 1, 4, 16, …
    Fours,
}

/// One series.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// Index of its colour.
    pub colour: usize,
    /// Both coordinates above zero.
    pub points: Vec<(f64, f64)>,
    /// A text beside each point; empty for none.
    pub labels: Vec<String>,
    /// Where a thin line from each point ends, as a second y; empty for none.
    pub stems: Vec<f64>,
    /// Whether a line joins the points.
    pub joined: bool,
}

/// One plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Above.
    pub title: String,
    /// Below.
    pub x_label: String,
    /// At the left, from below.
    pub y_label: String,
    /// Marks of the x axis.
    pub x_ticks: Ticks,
    /// The series.
    pub series: Vec<Series>,
    /// A dashed line `y = at_one · x^slope` with its name.
    pub guide: Option<(f64, f64, String)>,
}

/// Size of a plot in pixels.
pub const SIZE: (u32, u32) = (620, 400);

/// The rectangle of the data: left, top, right, bottom.
pub const FRAME: (i32, i32, i32, i32) = (74, 40, 604, 346);

const PALETTE: [RGBColor; 6] = [
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x1f, 0x7a, 0xc4),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xb0, 0x4f, 0x93),
    RGBColor(0x8a, 0x7a, 0x00),
    RGBColor(0x56, 0x6b, 0x7d),
];

/// Stands for `currentColor` until the SVG is done.
const INK: RGBColor = RGBColor(1, 2, 3);

/// A logarithmic axis onto pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    low: f64,
    high: f64,
    from: i32,
    to: i32,
}

impl Axis {
    /// Covers `values` with a margin.
    #[must_use]
    pub fn new(values: impl Iterator<Item = f64>, from: i32, to: i32) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter(|v| v.is_finite() && *v > 0.0) {
            low = low.min(v.log10());
            high = high.max(v.log10());
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let margin = 0.06 * (high - low).max(0.5);
        Self {
            low: low - margin,
            high: high + margin,
            from,
            to,
        }
    }

    /// The pixel of a value.
    #[must_use]
    pub fn pixel(&self, value: f64) -> f64 {
        let t = (value.log10() - self.low) / (self.high - self.low);
        f64::from(self.from) + t * f64::from(self.to - self.from)
    }

    fn contains(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value.log10())
    }

    fn ticks(&self, kind: Ticks) -> Vec<f64> {
        let decades = (self.low.floor() as i32)..=(self.high.ceil() as i32);
        let all: Vec<f64> = match kind {
            Ticks::Fours => (-2..20).map(|k| 4f64.powi(k)).collect(),
            Ticks::Decimal => {
                let span = self.high - self.low;
                let steps: &[f64] = match span {
                    s if s < 0.7 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0],
                    s if s < 1.7 => &[1.0, 2.0, 5.0],
                    s if s < 3.0 => &[1.0, 3.0],
                    _ => &[1.0],
                };
                decades
                    .step_by(if span > 9.0 { 2 } else { 1 })
                    .flat_map(|d| steps.iter().map(move |s| s * 10f64.powi(d)))
                    .collect()
            }
        };
        all.into_iter().filter(|v| self.contains(*v)).collect()
    }
}

/// A tick's text: plain from a thousandth to ten thousand, else a power.
fn tick_text(v: f64) -> String {
    let exponent = v.log10().floor() as i32;
    if (-3..=4).contains(&exponent) {
        let digits = usize::try_from(-exponent).unwrap_or(0);
        let text = format!("{v:.digits$}");
        // 1.5 needs a digit more.
        let exact = text.parse().is_ok_and(|t: f64| (t - v).abs() < 1e-9 * v);
        return if exact {
            text
        } else {
            format!("{v:.*}", digits + 1)
        };
    }
    let lead = (v / 10f64.powi(exponent)).round() as i32;
    if lead == 1 {
        format!("1e{exponent}")
    } else {
        format!("{lead}e{exponent}")
    }
}

impl Plot {
    /// The axes that [`Self::svg`] uses.
    #[must_use]
    pub fn axes(&self) -> (Axis, Axis) {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let stems = self.series.iter().flat_map(|s| s.stems.iter().copied());
        // A level line is data; a slope is only there to compare with.
        let level = self.guide.iter().filter(|g| g.1 == 0.0).map(|g| g.0);
        let heights = points().map(|p| p.1).chain(stems).chain(level);
        let mut y = Axis::new(heights, FRAME.3, FRAME.1);
        let falls = |s: &Series| match (s.points.first(), s.points.last()) {
            (Some(first), Some(last)) => s.joined && last.1 < 0.8 * first.1,
            _ => true,
        };
        if !self.series.iter().all(falls) {
            // Falling lines leave the lower left to the legend; others are kept
            // above it.
            let rows = self.series.len() + usize::from(self.guide.is_some());
            let legend = f64::from(18 * rows as i32 + 14);
            let height = f64::from(FRAME.3 - FRAME.1);
            y.low -= (y.high - y.low) * legend / (height - legend);
        }
        (Axis::new(points().map(|p| p.0), FRAME.0, FRAME.2), y)
    }

    /// The plot as an SVG document.
    ///
    /// # Errors
    /// If the library cannot draw it.
    pub fn svg(&self) -> Result<String, ReportError> {
        let mut text = String::new();
        self.draw(&mut text).map_err(|message| ReportError::Plot {
            title: self.title.clone(),
            message,
        })?;
        let ink = format!("#{:02X}{:02X}{:02X}", INK.0, INK.1, INK.2);
        Ok(text.replace(&ink, "currentColor").replacen(
            "<svg ",
            "<svg role=\"img\" style=\"max-width:100%;height:auto\" ",
            1,
        ))
    }

    fn draw(&self, svg: &mut String) -> Result<(), String> {
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        let fail = |e: DrawingAreaErrorKind<std::io::Error>| e.to_string();
        let (x_axis, y_axis) = self.axes();
        let (left, top, right, bottom) = FRAME;
        let at = |p: &(f64, f64)| {
            (
                x_axis.pixel(p.0).round() as i32,
                y_axis.pixel(p.1).round() as i32,
            )
        };
        let font = |size: i32| ("system-ui, sans-serif", f64::from(size) * 1.24).into_font();
        let ink = |size, h, v| TextStyle::from(font(size)).color(&INK).pos(Pos::new(h, v));
        let line = |points: Vec<(i32, i32)>, style: ShapeStyle| {
            root.draw(&PathElement::new(points, style)).map_err(fail)
        };
        let write = |text: &str, style: TextStyle<'_>, at: (i32, i32)| {
            root.draw(&Text::new(text.to_owned(), at, style))
                .map_err(fail)
        };

        write(&self.title, ink(14, HPos::Left, VPos::Center), (left, 20))?;
        for v in x_axis.ticks(self.x_ticks) {
            let x = x_axis.pixel(v).round() as i32;
            line(vec![(x, top), (x, bottom)], INK.mix(0.13).stroke_width(1))?;
            write(
                &tick_text(v),
                ink(12, HPos::Center, VPos::Top),
                (x, bottom + 7),
            )?;
        }
        for v in y_axis.ticks(Ticks::Decimal) {
            let y = y_axis.pixel(v).round() as i32;
            line(vec![(left, y), (right, y)], INK.mix(0.13).stroke_width(1))?;
            write(
                &tick_text(v),
                ink(12, HPos::Right, VPos::Center),
                (left - 7, y),
            )?;
        }
        line(
            vec![(left, top), (left, bottom), (right, bottom)],
            INK.mix(0.6).stroke_width(1),
        )?;
        let middle = (left + right) / 2;
        write(
            &self.x_label,
            ink(12, HPos::Center, VPos::Center),
            (middle, bottom + 40),
        )?;
        write(
            &self.y_label,
            ink(12, HPos::Center, VPos::Center).transform(FontTransform::Rotate270),
            (18, (top + bottom) / 2),
        )?;

        if let Some((at_one, slope, name)) = &self.guide {
            self.draw_guide(&x_axis, &y_axis, *at_one, *slope, &line)?;
            let y = bottom - 14 - 18 * self.series.len() as i32;
            for k in 0..4 {
                let x = left + 12 + 6 * k;
                line(vec![(x, y), (x + 3, y)], INK.mix(0.7).stroke_width(1))?;
            }
            write(name, ink(12, HPos::Left, VPos::Center), (left + 42, y))?;
        }
        for (i, series) in self.series.iter().enumerate() {
            let colour = PALETTE[series.colour % PALETTE.len()];
            let pixels: Vec<_> = series.points.iter().map(at).collect();
            if series.joined && pixels.len() > 1 {
                line(pixels.clone(), colour.stroke_width(2))?;
            }
            for (k, &p) in pixels.iter().enumerate() {
                if let Some(&stem) = series.stems.get(k) {
                    let end = at(&(series.points[k].0, stem)).1;
                    line(vec![p, (p.0, end)], colour.mix(0.6).stroke_width(2))?;
                    line(vec![(p.0 - 4, end), (p.0 + 4, end)], colour.stroke_width(2))?;
                }
                root.draw(&Circle::new(p, 4, colour.filled()))
                    .map_err(fail)?;
            }
            let y = self.legend_row(i);
            line(
                vec![(left + 12, y), (left + 34, y)],
                colour.stroke_width(if series.joined { 2 } else { 0 }),
            )?;
            // A square, so that circles are data and nothing else.
            root.draw(&Rectangle::new(
                [(left + 20, y - 4), (left + 28, y + 4)],
                colour.filled(),
            ))
            .map_err(fail)?;
            write(
                &series.name,
                ink(12, HPos::Left, VPos::Center),
                (left + 42, y),
            )?;
        }
        // After all points, so that labels keep clear of each of them.
        let mut taken: Vec<[i32; 4]> = self
            .series
            .iter()
            .flat_map(|s| s.points.iter().map(&at))
            .map(|p| [p.0 - 5, p.1 - 5, p.0 + 5, p.1 + 5])
            .collect();
        for series in &self.series {
            let named = series.points.iter().map(&at).zip(&series.labels);
            for (p, label) in named.filter(|n| !n.1.is_empty()) {
                let place = Label::place(p, label, &taken, (left, right));
                taken.push(place.covers);
                // In the colour of its point, as several may be near.
                let colour = PALETTE[series.colour % PALETTE.len()];
                let style = ink(11, place.from, VPos::Center).color(&colour);
                write(label, style, place.at)?;
            }
        }
        root.present().map_err(fail)
    }

    /// The middle of a legend's row, counted from the top.
    fn legend_row(&self, i: usize) -> i32 {
        FRAME.3 - 14 - 18 * (self.series.len() - 1 - i) as i32
    }

    fn draw_guide(
        &self,
        x_axis: &Axis,
        y_axis: &Axis,
        at_one: f64,
        slope: f64,
        line: &dyn Fn(Vec<(i32, i32)>, ShapeStyle) -> Result<(), String>,
    ) -> Result<(), String> {
        const DASHES: i32 = 80;
        let x = |i: i32| {
            let t = f64::from(i) / f64::from(DASHES);
            10f64.powf(x_axis.low + t * (x_axis.high - x_axis.low))
        };
        for i in (0..DASHES).step_by(2) {
            let ends = [x(i), x(i + 1)].map(|x| (x, at_one * x.powf(slope)));
            if ends.iter().all(|p| y_axis.contains(p.1)) {
                let pixels = ends.map(|p| {
                    (
                        x_axis.pixel(p.0).round() as i32,
                        y_axis.pixel(p.1).round() as i32,
                    )
                });
                line(pixels.to_vec(), INK.mix(0.7).stroke_width(1))?;
            }
        }
        Ok(())
    }
}

/// Where a point's label goes.
struct Label {
    from: HPos,
    at: (i32, i32),
    /// Left, top, right, bottom.
    covers: [i32; 4],
}

impl Label {
    /// The first place of some around the point that is inside the frame and
    /// covers nothing; of none, the one that covers the fewest.
    fn place(p: (i32, i32), label: &str, taken: &[[i32; 4]], (left, right): (i32, i32)) -> Self {
        // A letter of this size is about so wide.
        let width = (5.8 * label.chars().count() as f64) as i32;
        let beside = [0, -10, 10].map(|y| (8, y)).into_iter();
        let places = beside
            .clone()
            .chain(beside.map(|(x, y)| (-x - width, y)))
            .chain([(-width / 2, -14), (-width / 2, 14)])
            // A line farther, where points crowd.
            .chain([(8, -22), (8, 22), (-8 - width, -22), (-8 - width, 22)])
            .chain([(-width / 2, -26), (-width / 2, 26)]);
        let cost = |covers: &[i32; 4]| {
            let above = covers[1] < FRAME.1 - 12;
            let outside =
                covers[0] < left || covers[2] > right + 12 || above || covers[3] > FRAME.3;
            let hit = |t: &&[i32; 4]| {
                t[0] < covers[2] && covers[0] < t[2] && t[1] < covers[3] && covers[1] < t[3]
            };
            (outside, taken.iter().filter(hit).count())
        };
        let of = |(x, y): (i32, i32)| {
            let corner = (p.0 + x, p.1 + y);
            [corner.0, corner.1 - 6, corner.0 + width, corner.1 + 6]
        };
        let covers = places.map(of).min_by_key(cost);
        // There are fourteen.
        let covers = covers.unwrap_or_else(|| of((8, 0)));
        Self {
            from: HPos::Left,
            at: (covers[0], covers[1] + 6),
            covers,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_keep_clear_of_points_and_of_the_frame() {
        let clear = Label::place((100, 50), "seven", &[], (60, 600));
        assert_eq!(clear.at, (108, 50));
        let crowded = Label::place((100, 50), "seven", &[[110, 45, 120, 55]], (60, 600));
        assert!(crowded.covers[1] >= 55 || crowded.covers[3] <= 45 || crowded.covers[2] <= 110);
        // Where all eight near places are taken there is one a line farther.
        let full = Label::place((100, 50), "seven", &[[60, 30, 140, 66]], (0, 600));
        assert!(
            full.covers[1] >= 66 || full.covers[3] <= 30,
            "{:?}",
            full.covers
        );
        let at_the_end = Label::place((590, 50), "a long name for it", &[], (60, 600));
        assert!(at_the_end.covers[2] <= 600);
    }

    #[test]
    fn tick_texts() {
        let texts = [0.001, 0.02, 0.5, 1.0, 30.0, 20_000.0, 1e6, 2e-5].map(tick_text);
        let expected = ["0.001", "0.02", "0.5", "1", "30", "20000", "1e6", "2e-5"];
        assert_eq!(texts, expected);
    }

    #[test]
    fn axes_cover_their_values() {
        let axis = Axis::new([2.0, 2000.0].into_iter(), 100, 400);
        assert!(axis.pixel(2.0) > 100.0 && axis.pixel(2000.0) < 400.0);
        let middle = axis.pixel(2.0) + axis.pixel(2000.0);
        assert!((2.0 * axis.pixel(2.0 * 1000f64.sqrt()) - middle).abs() < 1e-9);
        assert_eq!(axis.ticks(Ticks::Fours), [4.0, 16.0, 64.0, 256.0, 1024.0]);
        let empty = Axis::new(std::iter::empty(), 0, 10);
        assert!(empty.pixel(5.0).is_finite());
    }
}
