// The parts of --help and of the man pages that follow the options: examples, signals, and exit
// statuses that a subcommand has to itself.
#pragma once

namespace CLI {
class App;
}

namespace fxagent {

/// Adds a footer to `app` and to each of its subcommands. A line that ends in a colon starts a
/// section.
void add_footers(CLI::App& app);

}  // namespace fxagent
