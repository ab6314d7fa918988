// Man pages and the completion of bash, made from the definition of the command line itself, so
// that neither can lag behind it. The package asks the program for them while it is made.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace CLI {
class App;
}

namespace fxagent {

/// Escapes text for roff: backslashes, hyphens, and a dot or a quote at the beginning of a line.
std::string roff(std::string_view text);

/// The man page of a subcommand, or of the program where it is null, in roff. `version` stands in
/// its foot.
std::string man_page(const CLI::App& app, const CLI::App* subcommand, const std::string& version);

/// A script for /usr/share/bash-completion/completions: subcommands and the options of each,
/// protocols, import formats, and the devices and tags of the config that is named before them.
/// Elsewhere bash offers files.
std::string bash_completion(const CLI::App& app);

/// Answers `--help-pages DIRECTORY`: writes fxagent.1, fxagent-SUBCOMMAND.1 for each,
/// fxagent.json.5 and fxagent.bash into that directory, which is there. The exit status, or nothing
/// where the arguments are others.
std::optional<int> write_command_pages(const CLI::App& app, int argc, const char* const* argv,
                                       const std::string& version);

}  // namespace fxagent
