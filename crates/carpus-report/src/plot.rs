//! Figures as SVG text. Colours come from classes, so that one figure serves light, dark and print.

use std::fmt::Write;

/// A straight map from data to drawing units.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    /// Data interval.
    pub data: [f64; 2],
    /// Where its ends are drawn.
    pub drawn: [f64; 2],
}

impl Scale {
    /// Where `value` is drawn.
    pub fn at(&self, value: f64) -> f64 {
        let width = self.data[1] - self.data[0];
        let share = if width == 0.0 { 0.5 } else { (value - self.data[0]) / width };
        self.drawn[0] + share * (self.drawn[1] - self.drawn[0])
    }
}

/// Round values (1, 2 or 5 times a power of ten apart) inside an interval, about `wanted` of them.
pub fn ticks(low: f64, high: f64, wanted: usize) -> Vec<f64> {
    let span = high - low;
    if span <= 0.0 || !span.is_finite() || wanted == 0 {
        return vec![low];
    }
    let raw = span / wanted as f64;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= raw * 0.999).unwrap_or(power);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// The text of a tick: as many decimals as the distance between ticks needs; a power of ten where these are more than
/// four.
pub fn tick_label(value: f64, step: f64) -> String {
    if step > 0.0 && step < 0.99e-4 {
        if value.abs() < 0.5 * step {
            return "0".to_string();
        }
        let power = |v: f64| (v.abs().log10() + 1e-9).floor();
        let digits = (power(value) - power(step)).max(0.0) as usize;
        return format!("{value:.digits$e}").replace('-', "−");
    }
    let decimals = if step > 0.0 { (-step.log10().floor()).clamp(0.0, 6.0) as usize } else { 0 };
    let text = format!("{value:.decimals$}");
    let text = if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') { "0".to_string() } else { text };
    text.replace('-', "−")
}

/// Smallest interval that holds all finite values; `None` if there is none.
pub fn extent(values: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    values.into_iter().filter(|v| v.is_finite()).fold(None, |found, v| match found {
        None => Some([v, v]),
        Some([low, high]) => Some([f64::min(low, v), f64::max(high, v)]),
    })
}

/// Widens an interval by a share of its width on both sides; a point becomes an interval.
pub fn padded([low, high]: [f64; 2], share: f64) -> [f64; 2] {
    let width = high - low;
    let margin = if width > 0.0 { share * width } else { 0.5 * high.abs().max(1e-3) };
    [low - margin, high + margin]
}

/// One curve.
#[derive(Clone, Debug)]
pub struct Curve<'a> {
    /// Class that gives its colour and stroke.
    pub class: String,
    /// Name shown when pointing at it.
    pub name: String,
    /// Values at the abscissae of the figure.
    pub values: &'a [f64],
}

/// Curves over a common abscissa.
#[derive(Clone, Debug)]
pub struct CurveFigure<'a> {
    /// What a screen reader says.
    pub description: String,
    /// Abscissae.
    pub x: &'a [f64],
    /// Name and unit of the abscissa, shown when pointing: `t`, `s`.
    pub x_name: (&'static str, &'static str),
    /// Unit of the curves.
    pub unit: &'static str,
    /// Curves, first drawn first.
    pub curves: Vec<Curve<'a>>,
    /// Interval of the abscissa.
    pub x_range: [f64; 2],
    /// Interval of the ordinate.
    pub y_range: [f64; 2],
    /// A second quantity drawn in a strip below, with name and unit: the angle of a movement.
    pub strip: Option<(&'a [f64], [f64; 2], &'static str)>,
    /// Drawing size.
    pub size: [f64; 2],
    /// About how many ticks: abscissa, ordinate.
    pub ticks: [usize; 2],
}

/// Least distance of the axis from the left edge.
const LEFT: f64 = 36.0;
/// Width of a character of a tick's label, and its distance from the axis.
const TICK_CHARACTER: f64 = 6.7;
const TICK_GAP: f64 = 5.0;
/// More points than this are one element.
const MANY_POINTS: usize = 100;
const RIGHT: f64 = 8.0;
const TOP: f64 = 8.0;
const BOTTOM: f64 = 20.0;
const STRIP: f64 = 34.0;

impl CurveFigure<'_> {
    /// The figure as SVG.
    pub fn svg(&self) -> String {
        self.draw(&[], &[], self.left())
    }

    /// The figure with its axis at `left`, as that of a figure above or below it.
    pub fn svg_from(&self, left: f64) -> String {
        self.draw(&[], &[], left)
    }

    /// Where the axis stands, so that the widest label of the ordinate is inside the drawing.
    pub fn left(&self) -> f64 {
        let [low, high] = self.y_range;
        let values = ticks(low, high, self.ticks[1]);
        let step = tick_step(&values);
        let widest = values.iter().map(|v| tick_label(*v, step).chars().count()).max().unwrap_or(0);
        LEFT.max(TICK_CHARACTER * widest as f64 + TICK_GAP)
    }

    /// The figure over bands: class, and lower and upper edge at the abscissae.
    pub fn svg_over(&self, bands: &[(&'static str, Vec<[f64; 2]>)]) -> String {
        self.draw(bands, &[], self.left())
    }

    /// As [`CurveFigure::svg_over`], with points that were measured: abscissa and ordinate.
    pub fn svg_with_points(&self, bands: &[(&'static str, Vec<[f64; 2]>)], points: &[[f64; 2]]) -> String {
        self.draw(bands, points, self.left())
    }

    fn draw(&self, bands: &[(&'static str, Vec<[f64; 2]>)], points: &[[f64; 2]], left: f64) -> String {
        let [width, height] = self.size;
        let strip_height = if self.strip.is_some() { STRIP } else { 0.0 };
        let x = Scale { data: self.x_range, drawn: [left, width - RIGHT] };
        let y = Scale { data: self.y_range, drawn: [height - BOTTOM - strip_height, TOP] };
        let mut svg = String::new();
        let w = &mut svg;
        let [x0, x1] = x.data;
        let [y0, y1] = y.data;
        let _ = write!(
            w,
            "<svg class=\"figure\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\" data-x=\"{x0} {x1} \
             {} {}\" data-y=\"{y0} {y1} {} {}\" data-x-name=\"{}\" data-x-unit=\"{}\" data-unit=\"{}\">",
            escape(&self.description),
            x.drawn[0],
            x.drawn[1],
            y.drawn[0],
            y.drawn[1],
            self.x_name.0,
            self.x_name.1,
            self.unit
        );
        self.draw_axes(w, x, y, height - BOTTOM);
        if let Some((values, range, name)) = self.strip {
            let [top, bottom] = [height - BOTTOM - STRIP + 10.0, height - BOTTOM - 2.0];
            self.draw_strip(w, x, values, Scale { data: range, drawn: [bottom, top] }, name);
        }
        for (class, edges) in bands {
            let lower = polyline(self.x, &edges.iter().map(|e| e[0]).collect::<Vec<_>>(), x, y);
            let mut upper: Vec<[f64; 2]> = self.x.iter().zip(edges).map(|(x, e)| [*x, e[1]]).collect();
            upper.reverse();
            let (xs, ys): (Vec<f64>, Vec<f64>) = upper.into_iter().map(|[x, y]| (x, y)).unzip();
            let _ = write!(w, r#"<polygon class="band {class}" points="{lower} {}"/>"#, polyline(&xs, &ys, x, y));
        }
        for curve in &self.curves {
            let points = polyline(self.x, curve.values, x, y);
            let class = &curve.class;
            let name = escape(&curve.name);
            let _ = write!(w, r#"<polyline class="curve {class}" data-name="{name}" points="{points}"/>"#);
        }
        let places = points.iter().map(|[at, value]| (x.at(*at), y.at(*value)));
        if points.len() > MANY_POINTS {
            let dots: String = places.map(|(cx, cy)| format!("M{cx:.1},{cy:.1}h0")).collect();
            let _ = write!(w, r#"<path class="dots measured" d="{dots}"/>"#);
        } else {
            for (cx, cy) in places {
                let _ = write!(w, r#"<circle class="dot measured" cx="{cx:.1}" cy="{cy:.2}" r="2.6"/>"#);
            }
        }
        w.push_str("</svg>");
        svg
    }

    fn draw_axes(&self, w: &mut String, x: Scale, y: Scale, bottom: f64) {
        let [left, right] = x.drawn;
        let y_ticks = ticks(y.data[0], y.data[1], self.ticks[1]);
        let step = tick_step(&y_ticks);
        for value in &y_ticks {
            let at = y.at(*value);
            let class = if value.abs() < 1e-12 { "zero" } else { "grid" };
            let label = tick_label(*value, step);
            let _ = write!(w, r#"<line class="{class}" x1="{left}" x2="{right}" y1="{at:.1}" y2="{at:.1}"/>"#);
            let _ = write!(w, r#"<text class="tick y" x="{:.1}" y="{:.1}">{label}</text>"#, left - TICK_GAP, at + 3.5);
        }
        let x_ticks = ticks(x.data[0], x.data[1], self.ticks[0]);
        let step = tick_step(&x_ticks);
        for (i, value) in x_ticks.iter().enumerate() {
            let at = x.at(*value);
            let unit = if i + 1 == x_ticks.len() { self.x_name.1 } else { "" };
            let label = tick_label(*value, step);
            let anchor = if at > right - 8.0 { "end" } else { "middle" };
            let at_text = if at > right - 8.0 { right + RIGHT - 2.0 } else { at };
            let _ = write!(w, r#"<line class="mark" x1="{at:.1}" x2="{at:.1}" y1="{bottom}" y2="{}"/>"#, bottom + 3.0);
            let _ = write!(
                w,
                r#"<text class="tick" text-anchor="{anchor}" x="{at_text:.1}" y="{}">{label}{}{unit}</text>"#,
                bottom + 14.0,
                if unit.is_empty() { "" } else { "\u{202f}" }
            );
        }
        let _ = write!(w, r#"<line class="axis" x1="{left}" x2="{right}" y1="{bottom}" y2="{bottom}"/>"#);
    }

    fn draw_strip(&self, w: &mut String, x: Scale, values: &[f64], y: Scale, name: &str) {
        let points = polyline(self.x, values, x, y);
        let [low, high] = y.data;
        for (value, at) in [(high, y.drawn[1] + 3.0), (low, y.drawn[0] + 1.0)] {
            let label = format!("{value:.0}°").replace('-', "−");
            let _ = write!(
                w,
                r#"<text class="tick y angle-text" x="{}" y="{at:.1}">{label}</text>"#,
                x.drawn[0] - TICK_GAP
            );
        }
        let _ = write!(
            w,
            "<polyline class=\"curve angle\" data-name=\"{name}\" data-unit=\"°\" data-y=\"{} {} {} {}\" \
             points=\"{points}\"/>",
            y.data[0], y.data[1], y.drawn[0], y.drawn[1]
        );
    }
}

/// Distance between ticks.
fn tick_step(ticks: &[f64]) -> f64 {
    ticks.windows(2).map(|t| t[1] - t[0]).next().unwrap_or(1.0)
}

fn polyline(xs: &[f64], ys: &[f64], x: Scale, y: Scale) -> String {
    let mut points = String::with_capacity(12 * xs.len());
    for (value_x, value_y) in xs.iter().zip(ys).filter(|(a, b)| a.is_finite() && b.is_finite()) {
        if !points.is_empty() {
            points.push(' ');
        }
        let _ = write!(points, "{:.1},{:.2}", x.at(*value_x), y.at(*value_y));
    }
    points
}

/// Text inside an XML attribute or element.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            other => out.push(other),
        }
    }
    out
}

/// Width and height of the small horizontal figures inside tables.
pub const ROW_SIZE: [f64; 2] = [280.0, 22.0];

/// A before-and-after mark on a horizontal axis from 0 to `max`.
pub fn dumbbell(before: Option<f64>, after: Option<f64>, max: f64) -> String {
    let [width, height] = ROW_SIZE;
    let x = Scale { data: [0.0, max], drawn: [6.0, width - 6.0] };
    let middle = height / 2.0;
    let mut w = format!(r#"<svg class="row" viewBox="0 0 {width} {height}" aria-hidden="true">"#);
    for value in ticks(0.0, max, 4) {
        let _ = write!(w, r#"<line class="grid" x1="{0:.1}" x2="{0:.1}" y1="0" y2="{height}"/>"#, x.at(value));
    }
    if let (Some(a), Some(b)) = (before, after) {
        let class = if b <= a { "fell" } else { "rose" };
        let _ = write!(
            w,
            r#"<line class="link {class}" x1="{:.1}" x2="{:.1}" y1="{middle}" y2="{middle}"/>"#,
            x.at(a),
            x.at(b)
        );
    }
    if let Some(a) = before {
        let _ = write!(w, r#"<circle class="dot before" cx="{:.1}" cy="{middle}" r="4.5"/>"#, x.at(a));
    }
    if let Some(b) = after {
        let _ = write!(w, r#"<circle class="dot after" cx="{:.1}" cy="{middle}" r="5"/>"#, x.at(b));
    }
    w.push_str("</svg>");
    w
}

/// The axis above a column of [`dumbbell`]s, in percent.
pub fn percent_axis(max: f64) -> String {
    let [width, height] = ROW_SIZE;
    let x = Scale { data: [0.0, max], drawn: [6.0, width - 6.0] };
    let mut w = format!(r#"<svg class="row" viewBox="0 0 {width} {height}" aria-hidden="true">"#);
    for value in ticks(0.0, max, 4) {
        let at = x.at(value);
        let anchor = if at < 20.0 {
            "start"
        } else if at > width - 20.0 {
            "end"
        } else {
            "middle"
        };
        let at = if anchor == "start" {
            0.0
        } else if anchor == "end" {
            width
        } else {
            at
        };
        let text = format!("{:.0}\u{202f}%", 100.0 * value);
        let _ = write!(w, r#"<text class="tick" text-anchor="{anchor}" x="{at:.1}" y="15">{text}</text>"#);
    }
    w.push_str("</svg>");
    w
}

/// Where a fitted value lies between its bounds (positions 0 to 1), with the value before as a tick and the interval as
/// a bar.
pub fn bounds_bar(before: f64, after: f64, interval: Option<[f64; 2]>, at_bound: bool) -> String {
    let [width, height] = ROW_SIZE;
    let x = Scale { data: [0.0, 1.0], drawn: [8.0, width - 8.0] };
    let middle = height / 2.0;
    let [a, b] = [x.at(before.clamp(0.0, 1.0)), x.at(after.clamp(0.0, 1.0))];
    let [low, high] = x.drawn;
    let class = if at_bound { "dot after bound" } else { "dot after" };
    let known = interval.map_or(String::new(), |ends| {
        let [from, to] = ends.map(|end| x.at(end.clamp(0.0, 1.0)));
        format!(r#"<line class="known" x1="{from:.1}" x2="{to:.1}" y1="{middle}" y2="{middle}"/>"#)
    });
    format!(
        concat!(
            r#"<svg class="row" viewBox="0 0 {width} {height}" aria-hidden="true">"#,
            r#"<line class="track" x1="{low}" x2="{high}" y1="{middle}" y2="{middle}"/>"#,
            r#"<line class="end" x1="{low}" x2="{low}" y1="5" y2="17"/>"#,
            r#"<line class="end" x1="{high}" x2="{high}" y1="5" y2="17"/>"#,
            r#"{known}<line class="link fell" x1="{a:.1}" x2="{b:.1}" y1="{middle}" y2="{middle}"/>"#,
            r#"<line class="start" x1="{a:.1}" x2="{a:.1}" y1="5" y2="17"/>"#,
            r#"<circle class="{class}" cx="{b:.1}" cy="{middle}" r="5"/></svg>"#
        ),
        width = width,
        height = height,
        low = low,
        high = high,
        middle = middle,
        known = known,
        a = a,
        b = b,
        class = class
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 1.0, 4), vec![0.0, 0.5, 1.0]);
        assert_eq!(ticks(-7.0, 7.0, 4), vec![-5.0, 0.0, 5.0]);
        let found = ticks(-0.31, 12.7, 5);
        assert!(found.iter().all(|t| (-0.31..=12.7).contains(t)) && found.len() >= 3, "{found:?}");
        assert_eq!(ticks(2.0, 2.0, 5), vec![2.0]);
    }

    #[test]
    fn verif_wide_labels_of_the_ordinate_stay_inside_the_drawing() {
        let [x, y] = [[0.0, 1.0], [-1.2e-4, 1.2e-4]];
        let figure = |y_range: [f64; 2]| CurveFigure {
            description: String::new(),
            x: &x,
            x_name: ("t", "s"),
            unit: "V",
            curves: Vec::new(),
            x_range: x,
            y_range,
            strip: None,
            size: [320.0, 90.0],
            ticks: [5, 4],
        };
        // "−0.0001" and "−100000" are about 44 wide in letters of 10.5
        for range in [y, [-1e5, 1e5]] {
            assert!(figure(range).left() > 49.0, "{}", figure(range).left());
        }
        assert_eq!(figure([0.0, 20.0]).left(), LEFT);
        assert!(figure(x).svg_from(60.0).contains(r#"class="axis" x1="60""#));
        assert_eq!([5e-5, -1.5e-4, 0.0].map(|v| tick_label(v, 5e-5)), ["5e−5", "−1.5e−4", "0"]);
        assert_eq!(tick_label(3e-9, 1e-9), "3e−9");
    }

    #[test]
    fn verif_tick_labels_carry_needed_decimals() {
        assert_eq!(tick_label(0.25, 0.05), "0.25");
        assert_eq!(tick_label(-5.0, 5.0), "−5");
        assert_eq!(tick_label(-0.0, 0.1), "0");
    }
}
