//! A self-contained HTML page: headings, text, tables and plots; the plotting script is inside, so
//! that the page needs no network.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use plotly::common::{Anchor, Orientation};
use plotly::layout::{Legend, Margin};
use plotly::{Configuration, Layout, Plot};

use crate::output::OutputFile;

/// Readable on a phone; on paper no plot is cut by the end of a page.
const STYLE: &str = "body{font-family:sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}\
    table{border-collapse:collapse;margin:1em 0;display:block;overflow-x:auto}\
    td,th{border:1px solid #ccc;padding:.3em .7em;text-align:left}\
    pre{background:#f4f4f4;padding:.7em;white-space:pre-wrap;overflow-wrap:anywhere;font-size:.85em}\
    pre.wide{white-space:pre;overflow-x:auto}\
    .tiles{display:flex;flex-wrap:wrap;gap:.7em;margin:1em 0}\
    .tiles div{border:1px solid #ccc;border-radius:.4em;padding:.5em .9em}\
    .tiles b{display:block;font-size:1.4em}.tiles small{color:#555}\
    .plot{height:22em}.plot.square{height:34em;max-width:36em}\
    @media(max-width:36em){.plot.square{height:27em}}\
    @media print{.plot,.tiles{break-inside:avoid}h2{break-after:avoid}}";

/// Draws the plots that come into view at once and the others one after the other, while nothing
/// else is to be done or before the page is printed. A time that is chosen in one plot is shown in
/// all of them. Fingers zoom without buttons, which would lie on the legend.
const DRAWING: &str = "<script>\
const waiting=new Set(document.querySelectorAll('div.plot'));\
const isTimed=plot=>plot.classList.contains('time');\
let shown=null,isLinking=false;\
function draw(plot){if(!waiting.delete(plot))return;\
const {data,layout,config}=JSON.parse(plot.querySelector('script').textContent);\
config.displayModeBar=matchMedia('(hover:hover)').matches?'hover':false;\
plot.whole=isTimed(plot)?layout.xaxis.range.slice():null;\
if(plot.whole&&innerWidth<600)layout.xaxis.nticks=4;\
if(plot.whole&&shown)layout.xaxis.range=shown.slice();\
Plotly.newPlot(plot,data,layout,config);\
if(plot.whole)plot.on('plotly_relayout',change=>link(plot,change));}\
function link(plot,change){\
if(isLinking||!Object.keys(change).some(key=>key.startsWith('xaxis.')))return;\
shown=change['xaxis.autorange']?null:plot.layout.xaxis.range.slice();\
isLinking=true;\
const others=[...document.querySelectorAll('div.plot.time')].filter(p=>!waiting.has(p));\
Promise.all(others.map(p=>Plotly.relayout(p,{'xaxis.range':(shown||p.whole).slice()})))\
.finally(()=>{isLinking=false;});}\
const watcher=new IntersectionObserver(seen=>seen.forEach(s=>s.isIntersecting&&draw(s.target)));\
waiting.forEach(plot=>watcher.observe(plot));\
function drawNext(){const [plot]=waiting;if(plot){draw(plot);setTimeout(drawNext,20);}}\
addEventListener('load',()=>setTimeout(drawNext,200));\
addEventListener('beforeprint',()=>[...waiting].forEach(draw));</script>\n";

/// Colours that colour-blind readers tell apart (Okabe and Ito, 2008).
pub(crate) mod colour {
    pub(crate) const BLUE: &str = "#0072B2";
    pub(crate) const ORANGE: &str = "#E69F00";
    pub(crate) const GREEN: &str = "#009E73";
    pub(crate) const VERMILION: &str = "#D55E00";
    pub(crate) const GREY: &str = "#888888";
}

/// An empty plot: legend above it, as high as it has to be, narrow margins, no buttons but those on
/// the plot itself.
pub(crate) fn laid_out(layout: Layout) -> Plot {
    let mut plot = Plot::new();
    let legend =
        Legend::new().orientation(Orientation::Horizontal).y(1.02).y_anchor(Anchor::Bottom);
    plot.set_layout(
        layout.legend(legend).margin(Margin::new().left(55).right(15).top(30).bottom(45)),
    );
    plot.set_configuration(Configuration::new().responsive(true).display_logo(false));
    plot
}

/// A page in the making.
#[derive(Debug)]
pub(crate) struct Page {
    title: String,
    body: String,
    plots: usize,
}

impl Page {
    /// A page with this title as its first heading.
    pub(crate) fn new(title: &str) -> Self {
        let mut page = Self { title: escape(title), body: String::new(), plots: 0 };
        let _ = writeln!(page.body, "<h1>{}</h1>", page.title);
        page
    }

    /// A heading.
    pub(crate) fn heading(&mut self, text: &str) {
        let _ = writeln!(self.body, "<h2>{}</h2>", escape(text));
    }

    /// A paragraph of plain text; what stands between backticks is code.
    pub(crate) fn paragraph(&mut self, text: &str) {
        let escaped = escape(text);
        let parts = escaped.split('`').enumerate().map(|(k, part)| match k {
            0 => part.to_owned(),
            odd if odd % 2 == 1 => format!("<code>{part}"),
            _ => format!("</code>{part}"),
        });
        let _ = writeln!(self.body, "<p>{}</p>", parts.collect::<String>());
    }

    /// Numbers to be seen at a glance, each with its name; what stands behind a comma is small.
    pub(crate) fn tiles(&mut self, tiles: &[[String; 2]]) {
        self.body.push_str("<div class=\"tiles\">");
        for [name, value] in tiles {
            let (value, more) = value.split_once(", ").unwrap_or((value, ""));
            let [name, value, more] = [name.as_str(), value, more].map(escape);
            let _ = write!(
                self.body,
                "<div><small>{name}</small><b>{value}</b><small>{more}</small></div>"
            );
        }
        self.body.push_str("</div>\n");
    }

    /// A table behind a line of text, shown when the line is touched.
    pub(crate) fn folded_table(&mut self, line: &str, header: &[&str], rows: &[Vec<String>]) {
        let _ = writeln!(self.body, "<details><summary>{}</summary>", escape(line));
        self.table(header, rows);
        self.body.push_str("</details>\n");
    }

    /// A table of plain text; without a row of headings if it has none.
    pub(crate) fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let cells = |tag: &str, texts: Vec<String>| -> String {
            texts.iter().map(|text| format!("<{tag}>{}</{tag}>", escape(text))).collect()
        };
        let header: Vec<String> = header.iter().map(|text| (*text).to_owned()).collect();
        self.body.push_str("<table>\n");
        if !header.is_empty() {
            let _ = writeln!(self.body, "<tr>{}</tr>", cells("th", header));
        }
        for row in rows {
            let _ = writeln!(self.body, "<tr>{}</tr>", cells("td", row.clone()));
        }
        self.body.push_str("</table>\n");
    }

    /// Text as it stands, with its line breaks.
    pub(crate) fn verbatim(&mut self, text: &str) {
        let _ = writeln!(self.body, "<pre>{}</pre>", escape(text));
    }

    /// Text in columns, which are kept on narrow screens too.
    pub(crate) fn columns(&mut self, text: &str) {
        let _ = writeln!(self.body, "<pre class=\"wide\">{}</pre>", escape(text));
    }

    /// A plot over the whole width.
    pub(crate) fn plot(&mut self, plot: &Plot) {
        self.place(plot, "plot", "");
    }

    /// A plot over time: all of these show one part of it.
    pub(crate) fn time_plot(&mut self, plot: &Plot) {
        self.place(plot, "plot time", "");
    }

    /// A plot over time that is only as high as its number of lines.
    pub(crate) fn time_plot_of_lines(&mut self, plot: &Plot, lines: usize) {
        let style = format!(" style=\"height:{}em\"", 8 + 2 * lines);
        self.place(plot, "plot time", &style);
    }

    /// A plot as high as it is wide.
    pub(crate) fn square_plot(&mut self, plot: &Plot) {
        self.place(plot, "plot square", "");
    }

    fn place(&mut self, plot: &Plot, class: &str, style: &str) {
        self.plots += 1;
        // Only `</` could end the script early.
        let json = plot.to_json().replace("</", "<\\/");
        let _ = writeln!(
            self.body,
            "<div id=\"plot-{}\" class=\"{class}\"{style}><script type=\"application/json\">{json}</script></div>",
            self.plots
        );
    }

    /// Writes the page as `directory/name`.
    pub(crate) fn write(&self, directory: &Path, name: &str) -> anyhow::Result<()> {
        let mut file = OutputFile::create(directory, name)?;
        write!(
            file,
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{}</title>\
             <style>{STYLE}</style>{}</head><body>\n{}{}</body></html>\n",
            self.title,
            if self.plots > 0 { plotting_script() } else { String::new() },
            self.body,
            if self.plots > 0 { DRAWING } else { "" }
        )?;
        file.finish()
    }
}

/// The plotting library; the script for formulas that comes behind it is left out (2 MB).
fn plotting_script() -> String {
    const END: &str = "</script>";
    let sources = Plot::offline_js_sources();
    let end = sources.find(END).map_or(sources.len(), |start| start + END.len());
    sources[..end].to_owned()
}

/// Text that cannot be taken for markup.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_be_markup_and_nothing_is_fetched() {
        let mut page = Page::new("<script>alert(1)</script>");
        page.table(&["a & b"], &[vec!["<b>".to_owned()]]);
        page.tiles(&[["<i>".to_owned(), "1 < 2".to_owned()]]);
        page.paragraph("`kurs <x>` says");
        page.plot(&Plot::new());
        let folder = tempfile::tempdir().unwrap();
        page.write(folder.path(), "page.html").unwrap();
        let text = std::fs::read_to_string(folder.path().join("page.html")).unwrap();
        assert!(text.contains("<h1>&lt;script&gt;alert(1)&lt;/script&gt;</h1>"));
        assert!(text.contains("<th>a &amp; b</th>") && text.contains("<td>&lt;b&gt;</td>"));
        assert!(text.contains("<small>&lt;i&gt;</small><b>1 &lt; 2</b>"));
        assert!(text.contains("<p><code>kurs &lt;x&gt;</code> says</p>"));
        assert!(!text.contains("<script src="), "no script from the network");
    }
}
