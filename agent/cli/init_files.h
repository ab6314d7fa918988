// What `fxagent init` writes: a config and what belongs to it. Pure.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "protocol/catalog.h"

namespace fxagent {

struct InitAnswers {
  std::string id = "edge1";
  std::string broker;  ///< "mqtt://host" with or without a port
  std::string user;    ///< of the agent at the broker; empty: the id where there is a password
  /// As in the config, relative to it. With neither user nor file the config has neither.
  std::string password_file;  ///< empty, with a user: "mqtt_password"
  std::string operator_name = "nodered";
  std::string protocol;
  std::string port;  ///< "/dev/ttyUSB0" or "host:port"
  std::string model;
  std::string unit;  ///< of Modbus, or station of a computer link; empty: the usual one
  std::string device = "plc1";
  std::vector<std::string> read;   ///< "D100" or "temp=D100"
  std::vector<std::string> write;  ///< the same, of tags that may be written
};

struct InitFile {
  std::string name;  ///< in the directory
  std::string text;
};

/// The names of all files, whatever the answers.
std::vector<std::string> init_file_names();

/// The files, which fit each other; the config passes check. `directory`: the absolute path where
/// they will be. The errors are those of all answers, one a line, in the words of the flags.
tl::expected<std::vector<InitFile>, std::string> init_files(const InitAnswers& answers,
                                                            const std::string& directory);

/// An address that every device of the protocol has, for an example.
std::string_view example_address(const ProtocolInfo& protocol);

}  // namespace fxagent
