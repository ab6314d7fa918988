// The part of --help and of the man pages that follows the options: examples and signals.
#pragma once

namespace CLI {
class App;
}

namespace fxagent {

/// Gives each subcommand of `app` its footer. A line that ends in a colon begins a section.
void add_footers(CLI::App& app);

}  // namespace fxagent
