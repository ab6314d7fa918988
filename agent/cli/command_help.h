// The parts of --help and of the man pages that follow the options: examples and signals.
#pragma once

namespace CLI {
class App;
}

namespace fxagent {

/// Adds a footer to each subcommand of `app`. A line that ends in a colon starts a section.
void add_footers(CLI::App& app);

}  // namespace fxagent
