// Keys of the configuration and of faults, read with their limits. An error names the key.
#pragma once

#include <chrono>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace fxsim {

using Keys = std::vector<std::string_view>;

// All throw ConfigError; `where` begins its text. What is missing has the value of `fallback`.
[[noreturn]] void fail(const std::string& where, const std::string& what);
void expect_keys(const nlohmann::json& object, const Keys& known, const std::string& where);
std::int64_t number(const nlohmann::json& object, const char* key, std::int64_t fallback,
                    std::int64_t least, std::int64_t most, const std::string& where);
std::chrono::milliseconds duration(const nlohmann::json& object, const char* key, int fallback,
                                   const std::string& where);
std::string text(const nlohmann::json& object, const char* key, std::string fallback,
                 const std::string& where);
bool flag(const nlohmann::json& object, const char* key, bool fallback, const std::string& where);
/// A text that is there and not empty.
std::string required(const nlohmann::json& object, const char* key, const std::string& where);

}  // namespace fxsim
