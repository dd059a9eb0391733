//! A robot for the tests: publishes clouds, IMU samples and fixed frames, asks for its pose, and says what it hears.
//!
//! It takes commands on its standard input and writes events to its standard output, one JSON object a line.
//! It ends with its input. Commands:
//!
//! * `{"show": {"points": FILE, "acceleration": [x, y, z]}}`: from now on, this is what its sensors see.
//!   The file holds x, y, z, intensity of every point as little-endian float32.
//! * `{"call": NUMBER}`: calls the service as soon as it is found; the response carries the number.

mod messages;
mod robot;
mod sensors;

use std::io::{stdin, BufRead};
use std::sync::mpsc::{channel, Receiver, TryRecvError};
use std::time::{Duration, Instant};

use robot::{Options, Robot};
use serde::Deserialize;

const CLOUDS_EVERY: Duration = Duration::from_millis(100);
const SAMPLES_EVERY: Duration = Duration::from_millis(20);
const LOOK_EVERY: Duration = Duration::from_millis(2);

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Command {
    Show { points: String, acceleration: [f64; 3] },
    Call(i64),
}

fn commands() -> Receiver<Command> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for line in stdin().lock().lines() {
            let command = serde_json::from_str(&line.expect("text")).expect("a command");
            if sender.send(command).is_err() {
                return;
            }
        }
    });
    receiver
}

fn main() {
    let given = std::env::args().nth(1).expect("the options, as JSON");
    let options: Options = serde_json::from_str(&given).expect("the options, as JSON");
    let mut robot = Robot::new(&options);
    let commands = commands();
    let (mut next_cloud, mut next_sample) = (Instant::now(), Instant::now());
    loop {
        match commands.try_recv() {
            Ok(Command::Show { points, acceleration }) => robot.show(&points, acceleration),
            Ok(Command::Call(number)) => robot.call(number),
            Err(TryRecvError::Disconnected) => return,
            Err(TryRecvError::Empty) => {}
        }
        let now = Instant::now();
        if now >= next_sample {
            next_sample = now + SAMPLES_EVERY;
            robot.publish_sample();
        }
        if now >= next_cloud {
            next_cloud = (next_cloud + CLOUDS_EVERY).max(now);
            robot.publish_cloud();
        }
        robot.hear();
        std::thread::sleep(LOOK_EVERY);
    }
}
