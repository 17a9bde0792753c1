"""Structures that no example of the training has: hashes alone, so that nothing of the benchmarks
is known here.

Those of all inverters of the benchmarks, in the settings that have words for them, and of the
paper's diagram as it is printed; a test compares them with the true programs.
"""

BARRED = frozenset(
    {
        "071de70822cf70fa4fe861d7fe370ede",
        "1d9d82330ec2098765c9d335f39d8ced",
        "2d6c85f33cae69b720cc44b2d95adcaf",
        "2dd79053e3c29f45a30c72260391aab5",
        "38ef0a93849a2dd92ffe783b2f4fd45c",
        "472b2afcff6734cd37dc50f6007714ac",
        "50b1d77fdd189ef6f24edd97e2f7737c",
        "60f2bdecf97f861063f27d6b3567f491",
        "77a0731f0ac069491fe5cbf301032dc0",
        "9f5014a2eef42931c4cc6154e7517c88",
        "b25fa6993072676e0772b5c7b993d205",
        "b3ea45b3da120dded238e8d44dbbbf3b",
        "d0e775e7cb08040ae50e247526a1fff6",
        "d6354db4883caa29c2a76c87c1be0eab",
        "d995f5261af143397e57750ba02ac76c",
        "dfe3c01f70cae41588659e3b7df01c7b",
        "e09c8f23121e8708be81a0339e38f2d0",
        "e5bd459fe10b26cc225a51ec9fbcaf1a",
        "e8e16d73f8d26537aac4fe644456fa2c",
        "f9224bc0fb507779560e3e897f989550",
        "fed4ac8a5aaa894f68fed0265c349d7c",
        "ffe6d2ff45bdfc3e5db54a4d7b0a797c",
    }
)
