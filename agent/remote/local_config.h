// The local config file as it is in force, and the configs built from it: alone, or merged with a
// remote config. The text stays in memory, because the file on disk may change before the next
// reload. One thread, except interrupt().
#pragma once

#include <atomic>
#include <cstdint>
#include <exception>
#include <string>
#include <tl/expected.hpp>
#include <utility>

#include "agent/config/model.h"
#include "agent/config/source.h"
#include "agent/remote/desired_config.h"

namespace fxagent {

struct LocalFile {
  std::string text;
  FilePrivacy privacy = FilePrivacy::shared;  ///< when the text was read
  RemoteLimits limits{};
};

class LocalConfig final {
 public:
  explicit LocalConfig(std::string path) : path_(std::move(path)) {}

  struct Read {
    LocalFile file;
    Config config;  ///< of `file` alone
  };
  /// Reads the file on disk. Does not put it in force.
  tl::expected<Read, ConfigErrors> read() const;
  /// Puts the file in force, at `now_ms` UTC. An empty one: remote config is not allowed.
  void put_in_force(LocalFile file, std::int64_t now_ms) {
    file_ = std::move(file);
    since_ms_ = now_ms;
  }

  const RemoteLimits& limits() const { return file_.limits; }
  /// Returns when the file was put in force, in ms UTC.
  std::int64_t since_ms() const { return since_ms_; }

  /// Return the config of the file in force, alone or merged with `document`. Errors: all of the
  /// config; meaningless after interrupt().
  tl::expected<Config, ConfigErrors> alone() const { return build(file_, nullptr); }
  tl::expected<Config, ConfigErrors> with(const DesiredConfig& document) const {
    return build(file_, &document);
  }
  /// The same for a file that is not in force. `document`: nullptr if there is none.
  tl::expected<Config, ConfigErrors> build(const LocalFile& file,
                                           const DesiredConfig* document) const;

  /// Ends reading and merging early, also later ones. Any thread.
  void interrupt() { interrupted_ = true; }
  bool is_interrupted() const { return interrupted_; }

 private:
  const std::string path_;
  LocalFile file_;
  std::int64_t since_ms_ = 0;
  std::atomic<bool> interrupted_ = false;
};

/// Returns the error of a config for an exception in building it, such as out of memory.
ConfigErrors not_built(const std::exception& fault);

}  // namespace fxagent
