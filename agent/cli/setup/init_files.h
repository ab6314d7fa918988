// Content of the files that `fxagent init` writes: a config and its companions. Pure.
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
  std::string user;    ///< MQTT user of the agent; empty: the id, if there is a password
  /// Path relative to the config. If user and file are both empty, the config contains neither.
  std::string password_file;  ///< empty with a user: "mqtt_password"
  std::string operator_name = "nodered";
  std::string protocol;
  std::string port;  ///< "/dev/ttyUSB0" or "host:port"
  std::string model;
  std::string unit;  ///< Modbus unit or computer link station; empty: the protocol's default
  std::string device = "plc1";
  std::vector<std::string> read;   ///< "D100" or "temp=D100"
  std::vector<std::string> write;  ///< the same, for writable tags
};

struct InitFile {
  std::string name;  ///< relative to the directory
  std::string text;
};

/// Returns the names of all files; they do not depend on the answers.
std::vector<std::string> init_file_names();

/// Returns a consistent set of files; the config passes `check`. `directory` is the absolute path
/// of their destination. The error lists the faults of all answers, one a line, in terms of the
/// flags.
tl::expected<std::vector<InitFile>, std::string> init_files(const InitAnswers& answers,
                                                            const std::string& directory);

/// Returns an address that every device of the protocol has, as an example.
std::string_view example_address(const ProtocolInfo& protocol);

}  // namespace fxagent
