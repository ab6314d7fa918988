// Each format is recognised by the beginning of the file.
#include "agent/import/formats.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

TEST(ImportFormats, EachTextIsOfOneAlone) {
  const std::map<std::string_view, const char*> texts{
      {"gx", "Device Name\tComment\nD0\tspeed\n"},
      {"kepware", "Tag Name,Address,Data Type\na,400001,Word\n"},
      {"neuron", R"({"nodes": [{"name": "a", "plugin": "Modbus TCP"}]})"},
      {"thingsboard", R"({"master": {"slaves": []}})"},
      {"telegraf", "[[inputs.modbus]]\nname = \"a\"\n"},
      {"csv", "device,name,address\nd,t,D0\n"}};
  ASSERT_EQ(texts.size(), import_formats().size());
  for (const auto& [name, text] : texts)
    for (const ImportFormat& format : import_formats())
      EXPECT_EQ(format.is_it(text), format.name == name) << name << " as " << format.name;
}

/// Detects the format as `import auto` does.
std::string_view found(std::string_view text) {
  for (const ImportFormat& format : import_formats())
    if (format.is_it(text)) return format.name;
  return "";
}

TEST(ImportFormats, AWordOfAnotherFormatInACellChangesNothing) {
  EXPECT_EQ(found("Device,Name,Address\npress1,speed,D0\n"), "csv");
  EXPECT_EQ(found("name,address\nDevice,D0\n"), "csv");
  EXPECT_EQ(found("group,name,address,attribute,type\ng,t,1!400010,Read,INT16\n"), "neuron");
  EXPECT_EQ(found("Tag Name,Address,Data Type\nDevice,400001,Word\n"), "kepware");
  EXPECT_FALSE(is_gx_comments("Device,Name,Address\npress1,speed,D0\n"));
}

TEST(ImportFormats, WhatIsNothingIsOfNone) {
  for (const char* text : {"", "{}", "[]", "hello", "a,b\n1,2\n", "\"", "[x"})
    for (const ImportFormat& format : import_formats())
      EXPECT_FALSE(format.is_it(text)) << text << " as " << format.name;
}

}  // namespace
}  // namespace fxagent
