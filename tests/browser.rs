//! The pages, used in a browser without a window. `cargo xtask browser` runs it where there is one.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// What is done with a page.
const SCRIPT: &str = include_str!("browser.js");

/// How long a browser may take to start and to use a page.
const PATIENCE: Duration = Duration::from_secs(60);

/// Least contrast of text (WCAG 2, level AA).
const CONTRAST_MIN: f64 = 4.5;

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("browser")
        .join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Makes results in a folder of this name.
fn made(name: &str, arguments: &[&str]) -> PathBuf {
    let out = folder(name);
    let output = Command::new(env!("CARGO_BIN_EXE_flexor"))
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .args(arguments)
        .args(["--out", out.to_str().unwrap()])
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    out
}

/// A browser that is ended with the test.
struct Browser(Child);

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// One request's method and body.
fn request(stream: &TcpStream) -> std::io::Result<(String, String)> {
    let mut reader = BufReader::new(stream);
    let mut line = String::new();
    reader.read_line(&mut line)?;
    let method = line.split(' ').next().unwrap_or_default().to_string();
    let mut length = 0;
    loop {
        let mut header = String::new();
        reader.read_line(&mut header)?;
        if header.trim().is_empty() {
            break;
        }
        if let Some(value) = header.to_lowercase().strip_prefix("content-length:") {
            length = value.trim().parse().unwrap_or(0);
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body)?;
    Ok((method, String::from_utf8_lossy(&body).into_owned()))
}

/// Gives `page` to whoever asks, until what its script saw is posted.
fn serve(listener: &TcpListener, page: &str) -> Value {
    listener.set_nonblocking(true).unwrap();
    let since = Instant::now();
    while since.elapsed() < PATIENCE {
        let Ok((mut stream, _)) = listener.accept() else {
            std::thread::sleep(Duration::from_millis(10));
            continue;
        };
        stream.set_nonblocking(false).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(5)))
            .unwrap();
        // A connection that was opened in advance may ask nothing.
        let Ok((method, body)) = request(&stream) else {
            continue;
        };
        if method == "POST" {
            return serde_json::from_str(&body).unwrap();
        }
        let length = page.len();
        let head = format!(
            "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
        );
        let _ = stream.write_all(head.as_bytes());
        let _ = stream.write_all(page.as_bytes());
    }
    panic!("the browser has not used the page in {PATIENCE:?}");
}

/// What the script saw of the page in `out`, in a window so wide, dark or light.
fn seen(out: &Path, width: u32, dark: bool) -> Value {
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    // The script is the test's own, and tells the test.
    let policy = "content=\"default-src 'none'; style-src 'unsafe-inline'";
    assert!(page.contains(policy));
    let more = format!("{policy}; connect-src 'self'");
    let mut used = page.replace(policy, &more);
    if !used.contains("script-src") {
        used = used.replace(&more, &format!("{more}; script-src 'unsafe-inline'"));
    }
    let used = used.replace("</body>", &format!("<script>{SCRIPT}</script></body>"));
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let browser = std::env::var_os("FLEXOR_BROWSER").expect("cargo xtask browser sets it");
    let profile = out.join(format!("profile_{width}_{dark}"));
    let scheme = if dark { 0 } else { 1 };
    let _browser = Browser(
        Command::new(browser)
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--no-first-run",
            ])
            .arg(format!("--user-data-dir={}", profile.display()))
            .arg(format!("--window-size={width},900"))
            .arg(format!("--blink-settings=preferredColorScheme={scheme}"))
            .arg(format!("http://{}/", listener.local_addr().unwrap()))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap(),
    );
    let seen = serve(&listener, &used);
    assert_eq!(seen["done"], true, "{seen}");
    seen
}

/// What holds of every page.
fn is_readable(seen: &Value, what: &str) {
    let number = |key: &str| seen[key].as_f64().unwrap();
    assert!(
        number("scroll") <= number("width"),
        "{what} scrolls sideways: {seen}"
    );
    let contrast = seen["contrast"][0].as_f64().unwrap();
    assert!(contrast >= CONTRAST_MIN, "{what}: {}", seen["contrast"]);
}

fn all_equal(list: &Value) -> bool {
    let list = list.as_array().unwrap();
    list.iter().all(|x| x == &list[0])
}

/// Column `name` of a CSV file, and its times.
fn column(file: &Path, name: &str) -> Vec<[f64; 2]> {
    let text = std::fs::read_to_string(file).unwrap();
    let mut lines = text.lines();
    let place = lines
        .next()
        .unwrap()
        .split(',')
        .position(|n| n == name)
        .unwrap();
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            [0, place].map(|i| cells[i].parse().unwrap())
        })
        .collect()
}

#[test]
#[ignore = "needs a browser: cargo xtask browser"]
fn the_demo_can_be_looked_into() {
    let out = made("demo", &["demo"]);
    assert!(out.join("report.html").metadata().unwrap().len() <= 2 << 20);
    let seen = seen(&out, 1400, false);
    is_readable(&seen, "demo");
    // One time for all, where the pointer is, with the values of the run.
    let hover = &seen["hover"];
    assert!(
        all_equal(&hover["cursors"]) && hover["moved"] == true,
        "{hover}"
    );
    let t = hover["t"].as_f64().unwrap();
    assert!((t - 0.6).abs() < 0.02, "{hover}");
    let run = out.join("proposed_stiffness_x0.9/run.csv");
    let shown = |panel: usize, curve: usize| -> f64 {
        let text = hover["values"][panel][1][curve].as_str().unwrap();
        text.parse().unwrap()
    };
    for (panel, curve, name, digit) in [
        (0, 1, "f_normal_N", 1e-4),
        (2, 1, "tau1_Nm", 1e-3),
        (3, 1, "tau2_Nm", 1e-5),
        (4, 1, "root_slope_rad", 1e-5),
    ] {
        let rows = column(&run, name);
        let near = rows
            .iter()
            .min_by(|a, b| (a[0] - t).abs().total_cmp(&(b[0] - t).abs()));
        let values = rows.iter().map(|row| row[1]);
        let spread = values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min);
        let off = (shown(panel, curve) - near.unwrap()[1]).abs();
        assert!(
            off <= 4e-4 * spread + 2.0 * digit,
            "{name}: off by {off}: {hover}"
        );
    }
    // A drag zooms, and the button shows all again.
    let zoomed = seen["zoomed"].as_str().unwrap();
    let from = zoomed
        .split("from=")
        .nth(1)
        .unwrap()
        .split('&')
        .next()
        .unwrap();
    assert!(
        (from.parse::<f64>().unwrap() - 0.2).abs() < 0.02,
        "{zoomed}"
    );
    assert!(!seen["reset"].as_str().unwrap().contains("from="), "{seen}");
    // A click on a row shows its run.
    let row = &seen["row"];
    assert_eq!((&row["chosen"], &row["select"]), (&"6".into(), &"5".into()));
    assert!(
        row["hash"].as_str().unwrap().starts_with("#case=6&"),
        "{row}"
    );
    assert_ne!(row["values"][0], hover["values"][0]);
    // The player moves arm and cursors together.
    let played = &seen["played"];
    assert!(played["to"].as_f64() > played["from"].as_f64(), "{played}");
    assert!(all_equal(&played["cursors"]), "{played}");
    let label = played["label"].as_str().unwrap();
    let time = format!("t = {:.4} s", played["to"].as_f64().unwrap());
    assert!(
        label.contains(&time) && label.contains("contact force"),
        "{label}"
    );
}

#[test]
#[ignore = "needs a browser: cargo xtask browser"]
fn every_page_is_readable_on_phones_and_in_the_dark() {
    let law = ["--controller", "examples/controller_paper.toml"];
    let scenario = ["--scenario", "examples/scenarios/bench.toml"];
    let campaign = [&["campaign", "--runs", "8"], &scenario[..], &law].concat();
    for (name, arguments) in [
        ("plan", &["plan"][..]),
        ("move", &["run", "--task", "examples/task_park.toml"]),
        ("gains", &["gains", law[0], law[1]]),
        ("accuracy", &["accuracy"]),
        ("campaign", &campaign),
    ] {
        let out = made(name, arguments);
        let bright = seen(&out, 1400, false);
        let phone = seen(&out, 390, true);
        assert_eq!(
            (&bright["dark"], &phone["dark"]),
            (&false.into(), &true.into())
        );
        assert!(phone["width"].as_f64().unwrap() < 520.0, "{phone}");
        is_readable(&bright, name);
        is_readable(&phone, name);
        if name != "campaign" {
            assert!(all_equal(&bright["hover"]["cursors"]), "{name}: {bright}");
            assert!(
                bright["zoomed"].as_str().unwrap().contains("from="),
                "{name}"
            );
        }
    }
}
