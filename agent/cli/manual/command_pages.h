// Generates the man pages and the bash completion from the definition of the command line, so that
// neither can become outdated. The package build calls the program to create them. Adds the parts
// of --help and of the man pages that follow the options: examples, signals, and exit statuses that
// a subcommand has to itself.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace CLI {
class App;
}

namespace fxagent {

/// Adds a footer to `app` and each subcommand. A line that ends in a colon starts a section.
void add_footers(CLI::App& app);

/// Returns "auto" and the names of the formats of `fxagent import`.
std::string import_format_names();

/// Escapes text for roff: backslashes, hyphens, and a dot or a quote at the start of a line.
std::string roff(std::string_view text);

/// Returns the man page of a subcommand in roff, or that of the program if `subcommand` is null.
/// `version` appears in the page footer.
std::string man_page(const CLI::App& app, const CLI::App* subcommand, const std::string& version);

/// Returns a script for /usr/share/bash-completion/completions. It completes subcommands and their
/// options, protocols, import formats, and the devices and tags of the config given earlier on the
/// line. Elsewhere bash offers files.
std::string bash_completion(const CLI::App& app);

/// Handles `--help-pages DIRECTORY`: writes fxagent.1, fxagent-SUBCOMMAND.1 for each subcommand,
/// fxagent.json.5 and fxagent.bash into an existing directory. Returns the exit status, or nullopt
/// for any other arguments.
std::optional<int> write_command_pages(const CLI::App& app, int argc, const char* const* argv,
                                       const std::string& version);

}  // namespace fxagent
