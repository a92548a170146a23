//! The streams as they run: started, restarted, exchanged by a reload.

use std::sync::{Arc, mpsc};

use tokio::task::JoinHandle;

use crate::input::{Event, Input, Known, Running, Shared};
use crate::intake::Intakes;
use crate::page::Command;
use crate::setup::{Reloaded, Setup};

/// The running inputs with what they were made of.
pub(crate) struct Inputs {
    running: Vec<(Input, JoinHandle<()>)>,
    pub(crate) intakes: Intakes,
    shared: Shared,
}

impl Inputs {
    /// None runs yet; what they will tell the engine comes out of the receiver.
    pub(crate) fn new(setup: &Setup, known: Arc<Known>) -> (Self, mpsc::Receiver<Event>) {
        let (events, received) = mpsc::channel();
        let shared = Shared {
            events,
            pace: Arc::default(),
            known,
            log_dir: setup.log_dir.clone(),
            read_samples: setup.imu.as_ref().map(|imu| Arc::clone(&imu.read)),
            once: setup.once,
        };
        let intakes = Intakes::new(&setup.inputs, setup.antennas);
        (Self { running: Vec::new(), intakes, shared }, received)
    }

    pub(crate) fn start(&mut self, input: Input) {
        let running = Running::new(input.clone(), self.intakes.of(&input), self.shared.clone());
        self.running.push((input, tokio::spawn(running.run())));
    }

    /// Tells the engine's thread.
    pub(crate) fn tell(&self, event: Event) {
        let _ = self.shared.events.send(event);
    }

    /// Does what the page asks for.
    pub(crate) fn obey(&mut self, Command::Restart { name, done }: Command) {
        let _ = done.send(self.restart(&name));
    }

    /// Connects the stream of this name anew; tells whether there is one.
    fn restart(&mut self, name: &str) -> bool {
        let is_named = |input: &Input| {
            let of_lines = input.lines.as_ref().is_some_and(|lines| lines.name() == name);
            of_lines || input.antennas.iter().any(|(_, of, _)| of == name)
        };
        let place = self.running.iter().position(|(input, task)| {
            // A recording would begin again, and an ended stream is counted out.
            is_named(input) && !input.address.is_file() && !task.is_finished()
        });
        let Some(place) = place else { return false };
        let input = self.end(place);
        tracing::info!(stream = name, "restarted");
        self.start(input);
        true
    }

    /// Ends a running stream.
    fn end(&mut self, place: usize) -> Input {
        let (input, task) = self.running.remove(place);
        task.abort();
        input.tell_end(&self.shared.events);
        input
    }

    /// Takes over a configuration that was read again, if that is possible without a restart.
    pub(crate) fn reload(&mut self, read: Result<Reloaded, String>) {
        match read {
            Ok(new) if new.antennas != self.intakes.antennas.len() => {
                tracing::error!("another number of antennas needs a restart; nothing was changed");
            }
            Ok(new) if !self.have_the_lines_of(&new.inputs) => {
                tracing::error!(
                    "another inertial sensor or other peers need a restart; nothing was changed"
                );
            }
            Ok(new) => {
                if !new.not_taken_over.is_empty() {
                    let keys = new.not_taken_over.join(", ");
                    tracing::warn!("changed, but only by a restart: {keys}");
                }
                self.change(new.inputs);
                self.tell(Event::Reload(new.make_engine));
            }
            Err(what) => tracing::error!("nothing was changed: {what}"),
        }
    }

    /// Whether the sensor and the peers are the same, wherever their lines come from.
    fn have_the_lines_of(&self, inputs: &[Input]) -> bool {
        let new = inputs.iter().filter_map(|input| input.lines.as_ref());
        self.running.iter().filter_map(|(input, _)| input.lines.as_ref()).eq(new)
    }

    /// Streams that are as before go on, others end, new ones begin.
    fn change(&mut self, inputs: Vec<Input>) {
        while let Some(place) = self.running.iter().position(|(input, _)| !inputs.contains(input)) {
            self.end(place);
        }
        for input in inputs {
            if !self.running.iter().any(|(running, _)| *running == input) {
                self.start(input);
            }
        }
    }

    /// Ends all of them.
    pub(crate) fn abort(&self) {
        self.running.iter().for_each(|(_, task)| task.abort());
    }
}
